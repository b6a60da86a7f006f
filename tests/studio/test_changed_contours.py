"""Edits of one contour of many: the same plan as from the beginning, for less work."""

import copy

import ezdxf
import numpy as np
import pytest

import armcontour as ac
from armcontour.files.job_file import drawing_text, read_job_mapping
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.tasks.dispatch import do
from armcontour.studio.tasks.figures import figures
from armcontour.studio.tasks.request import Request

CONTOURS = 6


@pytest.fixture
def text(tmp_path):
    """Job of a drawing with circles and squares on a UR5e."""
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    for k in range(CONTOURS):
        x = 20.0 * k
        if k % 2:
            space.add_circle((x, 0), 6.0)
        else:
            corners = [(x - 6, -6), (x + 6, -6), (x + 6, 6), (x - 6, 6)]
            space.add_lwpolyline(corners, close=True)
    document.saveas(tmp_path / "parts.dxf")
    return drawing_text("ur5e", tmp_path / "parts.dxf", tmp_path)


@pytest.fixture
def timed(monkeypatch):
    """The joint paths of the contours that are timed."""
    joint_paths = []
    time = ac.Optimal.time

    def record(options, joint_path, arm, limits):
        joint_paths.append(joint_path)
        return time(options, joint_path, arm, limits)

    monkeypatch.setattr(ac.Optimal, "time", record)
    return joint_paths


def slower(data, name, speed="30 mm/s"):
    changed = copy.deepcopy(data)
    changed["path"]["contours"] = {name: {"speed": speed}}
    return changed


def samples(plan):
    return plan.trajectory(np.linspace(0.0, plan.trajectory.duration, 500))


def test_a_changed_contour_is_planned_alone_with_the_plan_of_a_new_planner(text, tmp_path, timed):
    data = read_job_mapping(text, "job")
    planner = CoarsePlanner(tmp_path)
    first = planner.plan(data)
    names = [x.name for x in first.path.contours]
    assert len(names) == CONTOURS
    # The second plan begins at the start of the first one.
    planner.plan(data)
    for k in (1, 4):
        changed = slower(data, names[k])
        timed.clear()
        plan = planner.plan(changed)
        assert len(timed) <= 2, "the changed contour, and the first one, which is sought anew"
        other = CoarsePlanner(tmp_path).plan(changed)
        assert plan.trajectory.duration == pytest.approx(other.trajectory.duration, rel=1e-12)
        np.testing.assert_allclose(samples(plan), samples(other), rtol=0, atol=1e-12)
        for mine, its in zip(plan.explanation.bindings, other.explanation.bindings, strict=True):
            assert (mine.name, mine.t) == (its.name, pytest.approx(its.t, abs=1e-9))
        assert plan.trajectory.duration > first.trajectory.duration


def test_other_limits_and_another_arm_are_planned_anew(text, tmp_path):
    data = read_job_mapping(text, "job")
    planner = CoarsePlanner(tmp_path)
    planner.plan(data)
    changes = [{"limits": {**data["limits"], "speed": "20 mm/s"}}, {"arm": "ur10e"}]
    for change in changes:
        changed = {**copy.deepcopy(data), **change}
        plan = planner.plan(changed)
        expected = CoarsePlanner(tmp_path).plan(changed)
        assert plan.trajectory.duration == pytest.approx(expected.trajectory.duration, rel=1e-9)


def test_exact_figures_of_a_changed_contour_are_those_of_a_run(text, tmp_path):
    for speed in (None, "30 mm/s", "40 mm/s"):
        patch = {} if speed is None else {("path", "contours", "0-2", "speed"): speed}
        changed = text
        if speed is not None:
            changed = text.replace(
                "path:\n", f"path:\n  contours: {{0-2: {{speed: {speed}}}}}\n", 1
            )
        frame = figures(Request(text=changed, folder=str(tmp_path)))
        assert frame.kind == "figures", frame.header
        (tmp_path / "job.yaml").write_text(text)
        job = ac.read_job(tmp_path / "job.yaml", patch=patch)
        (result,) = ac.run(job).runs.values()
        shown = {x["name"]: x["value"] for x in frame.header["rows"]}
        assert shown["duration"] == result.trajectory.duration
        assert shown["off_drawing"] == result.to_data()["off_drawing"].value


def shown(text, folder, reading):
    """The frames of a state, by the task process; another reading begins without memory."""
    request = {"text": text, "folder": str(folder), "reading": reading}
    return [do(x, request, lambda step: None) for x in ("picture", "figures", "executed")]


def test_all_that_is_shown_after_an_edit_is_as_from_a_new_process(text, tmp_path):
    changed = [
        text.replace("path:\n", f"path:\n  contours: {{0-2: {{speed: {x} mm/s}}}}\n", 1)
        for x in (60, 30, 40)
    ]
    edited = [shown(x, tmp_path, 1) for x in changed]
    durations = {str(x[0].header["rows"]) for x in edited}
    assert len(durations) == 3
    for number, (one, frames) in enumerate(zip(changed, edited, strict=True), start=2):
        for frame, expected in zip(frames, shown(one, tmp_path, number), strict=True):
            assert frame.kind == expected.kind != "refusal"
            assert frame.header["rows"] == expected.header["rows"]
            for name, values in expected.arrays.items():
                np.testing.assert_array_equal(frame.arrays[name], values)
