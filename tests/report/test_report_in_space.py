"""The report of an arm in space: what stands in its figures is the study's."""

from __future__ import annotations

import dataclasses
import json
import re
from typing import Any

import numpy as np
import pytest
import yaml

from armcontour.arms import SerialArm
from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.report import render_report, sections
from armcontour.report.sections.corners import corners, replaced_paths
from armcontour.report.sections.space import FRAMES, MAGNIFICATIONS

UR = {
    "name": "corner",
    "arm": "ur5e",
    "path": {
        "points": [[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.25]],
        "orientation": {"rpy": [np.pi, 0, 0]},
    },
    "limits": {"speed": 0.25, "centripetal_acceleration": 1, "angular_speed": 1},
    "corners": {"tolerance": "1 mm", "angular_tolerance": "1 deg"},
    "servo": {"kp": 25, "kv": 150},
    "experiment": {"runs": ["tried"]},
    "runs": {
        "plain": {"compensation": {"method": "none"}},
        "slow": {"limits": {"speed": 0.1}, "command_interval": "10 ms"},
        "tried": {},
    },
}
PANDA = {
    "name": "line",
    "arm": "panda",
    "path": {
        "points": [[0.4, 0, 0.3], [0.45, 0.05, 0.3]],
        "orientation": {"axis": [0, 0, -1]},
    },
    "limits": {"speed": 0.25},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"one": {}},
}


@pytest.fixture(scope="module")
def study() -> Study:
    return run(parse_job(yaml.safe_dump(UR)))


@pytest.fixture(scope="module")
def page(study: Study) -> str:
    return render_report(study)


def trace(figure: Any, name: str) -> Any:
    (found,) = (x for x in figure.data if x.name == name)
    return found


def test_all_sections_are_there_in_order(page: str) -> None:
    keys = "overview paths speed bindings joints torques contour-error".split()
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)
    for key in ("joint-space", "accelerations"):
        assert f'<section id="{key}">' not in page


def test_works_offline(page: str) -> None:
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)


def test_the_page_is_not_much_larger_than_what_draws_it(page: str) -> None:
    from plotly.offline import get_plotlyjs

    assert len(page) - len(get_plotlyjs()) < 2.5e6


def test_errors_are_magnified_about_the_path(study: Study) -> None:
    section = sections.space(study)
    assert section is not None
    figure = section.figures[0]
    buttons = {x.label: x.args for x in figure.layout.updatemenus[0].buttons}
    assert list(buttons) == [f"{k}×" for k in MAGNIFICATIONS]
    for _, box, _ in buttons.values():
        sizes = [np.ptp(box[f"scene.{c}axis.range"]) for c in "xyz"]
        ratios = [box["scene.aspectratio"][c] for c in "xyz"]
        np.testing.assert_allclose(np.divide(sizes, ratios), sizes[0] / ratios[0])  # equal axes
    assert list(figure.layout.scene.xaxis.range) == buttons["1×"][1]["scene.xaxis.range"]
    _, _, which = buttons["1×"]
    moved = [figure.data[i] for i in which]
    assert [x.name for x in moved] == ["plain", "slow", "tried", "tried, experiment"]
    for i, found in enumerate(moved):
        result = study.runs[found.name.removesuffix(", experiment")]
        at = {k: np.array([buttons[f"{k}×"][0][c][i] for c in "xyz"]).T for k in MAGNIFICATIONS}
        np.testing.assert_allclose([found.x, found.y, found.z], at[1].T, atol=1e-3)
        path = result.path.path
        nearest = path(path.project(at[1] * 1e-3).s) * 1e3
        for k in (10, 100):
            np.testing.assert_allclose(at[k] - nearest, k * (at[1] - nearest), atol=k * 2e-4)
        # The largest error is among what is drawn.
        e = (result.experiment or result).evaluation if "experiment" in found.name else None
        worst = (e or result.evaluation).contour_error.max
        drawn = np.linalg.norm(at[1] - nearest, axis=1).max()
        assert drawn == pytest.approx(worst * 1e3, rel=1e-2)


def test_a_joint_without_ends_is_free(study: Study) -> None:
    (first, *_) = study.runs.values()
    upper, lower = np.array([[np.inf, 6.0, 3.0, 6.0, 6.0, np.inf], [-np.inf, *(5 * [-6.0])]])
    limits = first.run.limits.replace(joint_lower=lower, joint_upper=upper)
    run = dataclasses.replace(first.run, limits=limits)
    section = sections.joints(Study(job=study.job, runs={"a": dataclasses.replace(first, run=run)}))
    assert section is not None
    ranges = [x[1] for x in section.tables[0].rows]
    assert [ranges[0], ranges[1], ranges[5]] == ["free", "-6.000 to 6.000", "-6.000 to free"]


def test_the_arm_moves_as_executed(study: Study) -> None:
    section = sections.space(study)
    assert section is not None
    figure = section.figures[-1]
    assert len(figure.frames) == len(figure.layout.sliders[0].steps) == FRAMES
    names = [x.name for x in figure.data]
    arms = ["plain", "slow", "tried"]
    assert names == ["objective path", *arms, "plane of the base", "base_link_inertia"]
    for k in (0, FRAMES // 2):
        t = float(figure.layout.sliders[0].steps[k].label)
        for data, name in zip(figure.frames[k].data, arms, strict=True):
            done = study.runs[name].execution
            q = [np.interp(t, done.t, x) for x in done.q.T]
            links = done.arm.links(np.array(q)) * 1e3
            np.testing.assert_allclose(np.stack([data.x, data.y, data.z], axis=1), links, atol=3)
    # Arms that would hide each other wait in the legend.
    assert [x.visible for x in figure.data[1:4]] == [None, None, "legendonly"]


def test_the_tools_axes_are_drawn_along_the_path(study: Study) -> None:
    section = sections.space(study)
    assert section is not None
    found = trace(section.figures[0], "tool axis")
    z = np.array(found.z).reshape(-1, 3)
    assert np.all(z[:, 1] > z[:, 0]) and np.isnan(z[:, 2]).all()  # it points down, to the work
    assert trace(section.figures[0], "tool x axis") is not None


def test_corners_are_shown_in_their_own_plane(study: Study) -> None:
    (figure,) = corners(study)
    path = study.runs["plain"].path.path
    rounded = trace(figure, "rounded path")
    nearest = np.hypot(rounded.x, rounded.y).min()
    assert nearest == pytest.approx(path.corners.error[0] * 1e3, rel=1e-2)  # type: ignore[attr-defined]
    objective = trace(figure, "objective path")
    assert np.abs(objective.y[np.array(objective.x) < -1e-9]).max() < 1e-9
    assert trace(figure, "tried, experiment").line.dash == "dot"


def test_joints_with_their_limits(study: Study) -> None:
    section = sections.joints(study)
    assert section is not None
    assert len(section.figures) == len(section.tables) == 3
    table = section.tables[0]
    assert table.header[-1] == "planned torque [N m]"
    assert [x[0] for x in table.rows] == list(study.job.arm.joint_names)
    done = study.runs["plain"].execution
    speed = np.abs(done.dq[:, 0]).max()
    assert table.rows[0][3] == f"{speed:.4g} of 3.142 ({speed / np.pi:.0%})"
    labels = {x.name for x in section.figures[2].data}
    assert labels == {"planned", "executed", "experiment"}
    assert {x.name for x in section.figures[0].data} == {"planned", "executed"}


def test_torques_of_plan_and_experiment_with_what_they_rest_on(study: Study, page: str) -> None:
    section = sections.torques(study)
    assert section is not None
    assert {x.name for x in section.figures[2].data} == {"planned", "experiment: applied"}
    (note,) = section.notes
    assert "drives' own inertia" in note
    assert "listed under Drive torques" in page


def test_experiments_stand_beside_the_servo_over_time(study: Study, page: str) -> None:
    section = sections.contour_error(study)
    (found,) = (x for x in section.figures[0].data if x.name.startswith("tried, experiment"))
    experiment = study.runs["tried"].experiment
    assert experiment is not None
    assert f"{experiment.evaluation.contour_error.rms * 1e3:.4f}, largest" in found.name
    assert found.line.dash == "dot"
    assert section.notes[0].startswith("About the masses of the experiment:")
    assert f"{experiment.evaluation.contour_error.rms * 1e3:.4f} mm" in page
    titles = [x.layout.title.text for x in section.figures]
    assert titles == ["Contour error over time", "Orientation error over time"]


def test_angular_speed_stands_beside_the_linear_one(study: Study) -> None:
    section = sections.tool_speed(study)
    assert len(section.figures) == 2
    assert "limit 57.2958 deg/s" in {x.name for x in section.figures[1].data}


def test_seven_joints_have_a_report() -> None:
    study = run(parse_job(yaml.safe_dump(PANDA)))
    page = render_report(study)
    assert "panda_joint7" in page
    section = sections.space(study)
    assert section is not None
    assert "tool x axis" not in {x.name for x in section.figures[0].data}
    # What is embedded is JSON, without numbers that are none.
    given = re.findall(r'<script>draw\("[^"]+",(.*?)\);</script>', page, re.DOTALL)
    assert given
    for text in given:
        assert "NaN" not in text
        json.loads(f"[{text}]")


def test_an_arm_without_bodies_has_no_torques() -> None:
    limits = {**PANDA["limits"], "joint_torque": None}
    job = parse_job(yaml.safe_dump(PANDA | {"arm": "ur5e", "limits": limits}))
    own = job.arm
    assert own.chain is not None
    arm = SerialArm(
        name=own.name,
        chain=own.chain.replace(masses=None),
        limits=own.limits.replace(joint_torque=None),
    )
    study = run(dataclasses.replace(job, arm=arm))
    assert sections.torques(study) is None
    section = sections.joints(study)
    assert section is not None
    assert "planned torque [N m]" not in section.tables[0].header


def test_rounded_paths_that_differ_are_all_drawn() -> None:
    runs = {
        "plain": {},
        "same": {"compensation": {"method": "none"}},
        "wide": {"corners": {"tolerance": "4 mm", "angular_tolerance": "5 deg"}},
    }
    zigzag = [[0.4 + 0.02 * (k % 2), 0.02 * k, 0.2] for k in range(8)]
    path = {**UR["path"], "points": zigzag}  # type: ignore[dict-item]
    job = {k: v for k, v in UR.items() if k != "experiment"}
    study = run(parse_job(yaml.safe_dump(job | {"runs": runs, "path": path})))
    expected = {"rounded path of plain", "rounded path of wide"}
    section = sections.space(study)
    assert section is not None
    (figure,) = corners(study)
    for found in (section.figures[0], figure):
        drawn = [x for x in found.data if x.name.startswith("rounded path")]
        assert {x.name for x in drawn} == expected
        assert len({x.line.dash for x in drawn}) == 2
    title = figure.layout.title.text
    assert "the first 4 of 6" in title and "(r, error: rounded path of plain)" in title


def test_accelerations_have_a_limit_per_direction_and_jerk_has_one() -> None:
    jerk = {"joint_jerk": 200}
    limits = {**UR["limits"], "joint_acceleration": 10, "joint_deceleration": 4, **jerk}  # type: ignore[dict-item]
    job = {k: v for k, v in UR.items() if k != "experiment"}
    study = run(parse_job(yaml.safe_dump(job | {"runs": {"one": {}}, "limits": limits})))
    section = sections.joints(study)
    assert section is not None
    ddq = study.runs["one"].execution.ddq
    for j, row in enumerate(section.tables[0].rows):
        down, up = -ddq[:, j].min(), ddq[:, j].max()
        share = max(down / 4, up / 10)
        limit = 4 if down / 4 > up / 10 else 10
        if share > 1e-3:
            assert row[4].endswith(f"of {limit} ({share:.0%})")
    assert section.tables[0].header[5] == "jerk [rad/s³]"
    executed = study.runs["one"].evaluation.jerk
    for j, row in enumerate(section.tables[0].rows):
        assert row[5].endswith(f"of 200 ({executed[j] / 200:.0%})")
    assert replaced_paths(study) == "the rounded path (rounded with continuous curvature)"
