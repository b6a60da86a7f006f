"""The report: its numbers are the evaluation's, it works offline, and text is escaped."""

import dataclasses

import numpy as np
import pytest

from armcontour.cli.running import built_in_job
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.report import render_report, write_report
from armcontour.report.sections import overview, paths
from armcontour.report.sections.motion import find_saturation
from armcontour.report.style import thin
from armcontour.servo import ServoModel

FIRST_ORDER = """
name: first
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20]]}
limits: {speed: 0.1}
servo: {order: first, kp: 25, dead_time: 12 ms}
runs: {one: {compensation: {method: inverse}}}
"""


@pytest.fixture(scope="module")
def study():
    """The paper's job, coarsely, to be quick."""
    job = built_in_job()
    coarse = tuple(dataclasses.replace(x, period=4e-3) for x in job.runs)
    return run(dataclasses.replace(job, runs=coarse, title="<b>T & J</b>"))


@pytest.fixture(scope="module")
def page(study):
    return render_report(study)


def test_the_page(study, page, in_order):
    for result in study.runs.values():
        e = result.evaluation
        rms, largest = (f"{x * 1e3:.4f} mm" for x in (e.contour_error.rms, e.contour_error.max))
        assert f"{e.duration:.3f} s" in page and rms in page and largest in page
    binds = "centripetal acceleration at s = 0.075 m: 0.0324 of 0.15 m/s"
    words = ("P9", "line 2: AVC", binds, "&lt;b&gt;T &amp; J&lt;/b&gt;")
    assert [x for x in words if x not in page] == []
    assert "<b>T & J</b>" not in page
    in_order(
        page,
        "overview paths joint-space speed bindings accelerations contour-error time-stamps",
    )
    assert paths(study).columns == (2, 3)  # a tall path leaves room for its corners
    assert 'class="figures beside" style="--columns: 2fr 3fr"' in page


def test_the_overview_compares_runs_in_a_table_or_shows_tiles(study):
    section = overview(study)
    (table,) = section.tables
    assert section.tiles == () and [row[0] for row in table.rows] == list(study.runs)
    found = dict(zip(table.header, table.rows[1], strict=True))
    assert found["motion"] == f"{study.runs['uncompensated'].evaluation.duration:.3f} s"
    assert found["saturated"].startswith("joint 1 ")
    result = study.runs["proposed"]
    for saturated, words in (
        ([0.0, 0.0], "no joint saturated"),
        ([0.0, 0.25], "saturated: joint 2 25.0% of the time"),
    ):
        evaluation = dataclasses.replace(result.evaluation, saturated=np.array(saturated))
        one = dataclasses.replace(result, evaluation=evaluation)
        ((_, tiles),) = overview(Study(job=study.job, runs={"proposed": one})).tiles
        assert words in tiles[3].note
    own = dataclasses.replace(result.run, compensation="inverse_dynamics")
    for_bodies = Study(job=study.job, runs={"proposed": dataclasses.replace(result, run=own)})
    ((_, tiles),) = overview(for_bodies).tiles  # what judges set-points for bodies comes first
    assert tiles[1].label.startswith("experiment: ") and tiles[1].label.endswith(tiles[2].label)


def test_a_failed_experiment_and_a_warning_stand_in_the_overview(study):
    failure = ExecutionError("experiment: joint 1 does not rest.")
    result = study.runs["proposed"]
    slow = dataclasses.replace(result.run, period=2.0)
    failed = dataclasses.replace(result, experiment=None, failure=failure, run=slow)
    job = study.job
    page = render_report(Study(job=job, runs={"proposed": failed}))
    assert f"Run proposed: {failure}" in page and "command interval of 2 s" in page


def test_other_servos_and_jobs_without_corners_have_a_report(study):
    page = render_report(run(parse_job(FIRST_ORDER)))
    header = page[page.index("<header>") : page.index("</header>")]
    assert "25.0 1/s, dead time 0.012 s</p>" in header and "K<sub>v</sub>" not in header
    # One gain for all joints, as a job made in Python may have it.
    servo = ServoModel(kp=25.0, kv=150.0)
    only = dataclasses.replace(study.job, runs=study.job.runs[:1], servo=servo, plant_servo=servo)
    page = render_report(run(only))
    assert "K<sub>p</sub> 25.0 1/s, K<sub>v</sub> 150.0 1/s</p>" in page
    for absent in ('<section id="bindings">', "Corners enlarged"):
        assert absent not in page


def test_writes_whole_or_not_at_all(study, tmp_path):
    write_report(study, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").endswith("</html>")
    with pytest.raises(InvalidInput):
        write_report(study, tmp_path / "none" / "report.html")
    assert [x.name for x in tmp_path.iterdir()] == ["report.html"]


def test_thinning_keeps_every_peak_and_both_ends_of_every_part():
    t = np.linspace(0, 1, 100_000)
    y = np.zeros_like(t)
    y[54_321], y[12_345] = 7.0, -3.0
    t2, y2 = thin(t, y)
    assert len(t2) < 4000 and np.all(np.diff(t2) > 0)
    assert (y2.max(), y2.min()) == (7.0, -3.0) and (t2[0], t2[-1]) == (0, 1)
    # Ten contours, each from rest to rest; the ends are no extremes of their intervals.
    y = np.tile(np.append(np.sin(np.linspace(0, np.pi, 4001)), np.nan), 10)
    _, y2 = thin(np.arange(len(y), dtype=float), y, most=500)
    gaps = np.flatnonzero(np.isnan(y2))
    assert len(gaps) == 10 and len(y2) < 600
    np.testing.assert_allclose([y2[0], *y2[gaps - 1], *y2[gaps[:-1] + 1]], 0.0, atol=1e-12)


def test_saturated_stretches_are_joined_where_they_are_neighbours():
    t = np.linspace(0, 10, 10_001)
    demand = np.zeros_like(t)
    demand[1000:2000], demand[2005:2991], demand[7000:], demand[5000] = 2.0, -2.0, 2.0, 1.0005
    found = find_saturation(t, demand, np.clip(demand, -1.0, 1.0))
    np.testing.assert_allclose(found, [(1.0, 2.99), (7.0, 10.0)])
