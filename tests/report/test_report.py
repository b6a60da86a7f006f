"""The report: its numbers are the evaluation's, it works offline, and text is escaped."""

import dataclasses

import numpy as np
import pytest

from armcontour.cli.running import built_in_job
from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.jobs import run
from armcontour.report import render_report, write_report
from armcontour.report.sections import paths
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
