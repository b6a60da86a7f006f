"""The report: its numbers are the evaluation's, it works offline, and text is escaped."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml

from armcontour.cli.running import built_in_job
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.io import parse_job
from armcontour.jobs import Experiment, RunResult, Study, run
from armcontour.report import render_report, write_report
from armcontour.report.sections import bindings, overview, paths
from armcontour.report.sections.motion import accelerations, contour_error, find_saturation
from armcontour.report.style import thin
from armcontour.servo import ServoModel


@pytest.fixture(scope="module")
def study() -> Study:
    """The paper's job, coarsely, to be quick."""
    job = built_in_job()
    coarse = tuple(dataclasses.replace(x, period=4e-3) for x in job.runs)
    return run(dataclasses.replace(job, runs=coarse, title="<b>T & J</b>"))


@pytest.fixture(scope="module")
def page(study: Study) -> str:
    return render_report(study)


def test_figures_of_the_evaluation_stand_in_the_page(study: Study, page: str) -> None:
    for result in study.runs.values():
        e = result.evaluation
        assert f"{e.duration:.3f} s" in page
        assert f"{e.contour_error.rms * 1e3:.4f} mm" in page
        assert f"{e.contour_error.max * 1e3:.4f} mm" in page


def test_published_figures_ratios_and_time_stamps_stand_beside_ours(page: str) -> None:
    for text in ("2.630 mm", "0.164 mm", "46.4%", "6.24%", "5.770", "P9", "line 2: AVC"):
        assert text in page


def test_published_figures_of_other_runs_are_left_out(study: Study) -> None:
    def only(name: str) -> str:
        return render_report(Study(job=study.job, runs={name: study.runs[name]}))

    page = only("conventional")
    assert "<td>2.630 mm</td>" in page and "<td>0.164 mm</td>" not in page
    assert 'id="published"' not in only("optimal")


def test_more_than_two_runs_are_compared_in_a_table(study: Study) -> None:
    section = overview(study)
    assert section.tiles == ()
    (table,) = section.tables
    assert [row[0] for row in table.rows] == list(study.runs)
    assert table.header[:2] == ("run", "motion")
    e = study.runs["uncompensated"].evaluation
    found = dict(zip(table.header, table.rows[1], strict=True))
    assert found["motion"] == f"{e.duration:.3f} s"
    assert found["saturated"].startswith("joint 1 ")


def test_tiles_say_who_was_saturated(study: Study) -> None:
    result = study.runs["proposed"]
    for saturated, words in (
        ([0.0, 0.0], "joint 2; no joint saturated"),
        ([0.0, 0.25], "joint 2; saturated: joint 2 25.0% of the time"),
    ):
        evaluation = dataclasses.replace(result.evaluation, saturated=np.array(saturated))
        one = dataclasses.replace(result, evaluation=evaluation)
        ((_, tiles),) = overview(Study(job=study.job, runs={"proposed": one})).tiles
        assert words[9:] in tiles[3].note


def test_compensation_that_does_harm_on_bodies_is_said(study: Study) -> None:
    assert not any("On rigid bodies" in x for x in overview(study).notes)

    def notes_on_bodies(runs: dict[str, RunResult]) -> list[str]:
        notes = overview(Study(job=study.job, runs=runs)).notes
        return [x for x in notes if x.startswith("On rigid bodies")]

    plain, made_up = study.runs["uncompensated"], study.runs["proposed"]
    assert plain.experiment is not None and made_up.experiment is not None
    swapped = {
        "uncompensated": dataclasses.replace(plain, experiment=made_up.experiment),
        "proposed": dataclasses.replace(made_up, experiment=plain.experiment),
    }
    (note,) = notes_on_bodies(swapped)
    assert note.startswith(
        "On rigid bodies the run proposed is farther from the path than uncompensated, which is "
        "the same plan without compensation"
    )
    assert note.endswith("leads the joints by too much or too little.")
    assert "as inverse_dynamics is" in note
    by_bodies = dataclasses.replace(swapped["proposed"].run, compensation="inverse_dynamics")
    other = {**swapped, "proposed": dataclasses.replace(swapped["proposed"], run=by_bodies)}
    told = overview(Study(job=study.job, runs=other)).notes
    assert any("are not those that the compensation knows, or its drives" in x for x in told)
    rubbed = dataclasses.replace(swapped["proposed"].run, experiment=Experiment(coulomb=6.0))
    swapped["proposed"] = dataclasses.replace(swapped["proposed"], run=rubbed)
    (note,) = notes_on_bodies(swapped)
    assert note.endswith(
        "too little; nor does it know what the robot has: Coulomb friction of 6 N m."
    )
    (said,) = contour_error(Study(job=study.job, runs=swapped)).notes[-1:]
    assert said.startswith("The simulated robot of proposed has what neither plan nor controller")


def test_what_judges_set_points_for_the_bodies_comes_first(study: Study) -> None:
    made = study.runs["proposed"]
    for_bodies = dataclasses.replace(
        made, run=dataclasses.replace(made.run, compensation="inverse_dynamics")
    )
    shown = Study(job=study.job, runs={"proposed": for_bodies})
    ((_, tiles),) = overview(shown).tiles
    assert [x.label for x in tiles[:3]] == [
        "motion",
        "experiment: contour error, RMS",
        "contour error, RMS",
    ]
    assert "the servo model, which has no bodies" in tiles[2].note
    assert any("its experiment judges it" in x for x in overview(shown).notes)


def test_a_failed_experiment_and_a_warning_stand_in_the_overview(study: Study) -> None:
    failed = dataclasses.replace(
        study.runs["proposed"],
        experiment=None,
        failure=ExecutionError("experiment: joint 1 does not rest."),
    )
    slow = dataclasses.replace(failed.run, period=2.0)
    job = dataclasses.replace(study.job, published=None)
    page = render_report(Study(job=job, runs={"proposed": dataclasses.replace(failed, run=slow)}))
    assert "Run proposed: experiment: joint 1 does not rest." in page
    assert "command interval of 2 s is more than a tenth of the motion" in page


def test_the_same_plan_is_explained_once(study: Study) -> None:
    one = study.runs["optimal"]
    two = dataclasses.replace(one, run=dataclasses.replace(one.run, name="again"))
    section = bindings(Study(job=study.job, runs={"optimal": one, "again": two}))
    assert section is not None
    assert [x.caption for x in section.tables] == ["Runs optimal and again"]
    assert len(section.figures) == 1
    assert "between two limits" in [row[0] for row in section.tables[0].rows]


def test_a_servo_of_first_order_has_a_report() -> None:
    text = yaml.safe_dump(
        {
            "name": "first",
            "arm": "pmk3s",
            "path": {"points": [[0.30, 0.20], [0.40, 0.20]]},
            "limits": {"speed": 0.1},
            "servo": {"order": "first", "kp": 25, "dead_time": "12 ms"},
            "runs": {"one": {"compensation": {"method": "inverse"}}},
        }
    )
    page = render_report(run(parse_job(text)))
    header = page[page.index("<header>") : page.index("</header>")]
    assert "25.0 1/s, dead time 0.012 s</p>" in header
    assert "K<sub>v</sub>" not in header


def test_a_tall_path_leaves_room_for_its_corners(study: Study, page: str) -> None:
    section = paths(study)
    assert section is not None
    assert section.columns == (2, 3)
    assert 'class="figures beside" style="--columns: 2fr 3fr"' in page


def test_all_sections_are_there_in_order(page: str) -> None:
    keys = (
        "overview published paths joint-space speed bindings accelerations contour-error "
        "time-stamps".split()
    )
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)


def test_what_binds_is_said_with_its_place(page: str) -> None:
    assert "centripetal acceleration at s = 0.075 m: 0.0324 of 0.15 m/s" in page


def test_works_offline_and_escapes_text(page: str) -> None:
    assert "<b>T & J</b>" not in page
    assert "&lt;b&gt;T &amp; J&lt;/b&gt;" in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)


def test_a_job_without_corners_or_published_figures_has_a_report(study: Study) -> None:
    # One gain for all joints, as a job made in Python may have it.
    servo = ServoModel(kp=25.0, kv=150.0)
    only = dataclasses.replace(
        study.job, runs=study.job.runs[:1], published=None, servo=servo, plant_servo=servo
    )
    page = render_report(run(only))
    assert "K<sub>p</sub> 25.0 1/s, K<sub>v</sub> 150.0 1/s</p>" in page
    assert '<section id="published">' not in page
    assert '<section id="bindings">' not in page
    assert "Corners enlarged" not in page


def test_writes_whole_or_not_at_all(study: Study, tmp_path: FilePath) -> None:
    write_report(study, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").endswith("</html>")
    with pytest.raises(InvalidInput, match="Cannot write the report"):
        write_report(study, tmp_path / "none" / "report.html")
    assert [x.name for x in tmp_path.iterdir()] == ["report.html"]


def test_thinning_keeps_every_peak() -> None:
    t = np.linspace(0, 1, 100_000)
    y = np.zeros_like(t)
    y[54_321] = 7.0
    y[12_345] = -3.0
    t2, y2 = thin(t, y)
    assert len(t2) < 4000
    assert (y2.max(), y2.min()) == (7.0, -3.0)
    assert np.all(np.diff(t2) > 0)
    assert (t2[0], t2[-1]) == (0, 1)


def test_thinning_keeps_both_ends_of_every_part() -> None:
    # Ten contours, each from rest to rest; the ends are no extremes of their intervals.
    parts = [np.append(np.sin(np.linspace(0, np.pi, 4001)), np.nan) for _ in range(10)]
    y = np.concatenate(parts)
    t = np.arange(len(y), dtype=float)
    t2, y2 = thin(t, y, most=500)
    gaps = np.flatnonzero(np.isnan(y2))
    assert len(gaps) == 10 and len(t2) < 600
    np.testing.assert_allclose([y2[0], *y2[gaps - 1], *y2[gaps[:-1] + 1]], 0.0, atol=1e-12)


def test_saturated_stretches_are_joined_where_they_are_neighbours() -> None:
    t = np.linspace(0, 10, 10_001)
    demand = np.zeros_like(t)
    demand[1000:2000] = 2.0
    demand[2005:2991] = -2.0
    demand[7000:] = 2.0
    demand[5000] = 1.0005
    assert find_saturation(t, demand, np.clip(demand, -1.0, 1.0)) == [
        (pytest.approx(1.0), pytest.approx(2.99)),
        (pytest.approx(7.0), pytest.approx(10.0)),
    ]


def test_limit_lines_of_accelerations_are_those_of_each_direction(study: Study) -> None:
    job = study.job
    one = dataclasses.replace(
        job.runs[0], limits=job.runs[0].limits.replace(joint_deceleration=0.5), experiment=None
    )
    section = accelerations(run(dataclasses.replace(job, runs=(one,), published=None)))
    assert section is not None
    lines = {x.y0 for x in section.figures[0].layout.shapes if x.type == "line" and x.y0 == x.y1}
    assert lines == {0.72, -0.5}
