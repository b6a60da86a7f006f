"""Suggested changes save the stated time, and repairs make a run kept."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.render import plain
from armcontour.files import parse_job
from armcontour.files.job_file import drawing_text
from armcontour.files.job_patch import key_of, resolve_patch
from armcontour.files.job_text_edits import change_data
from armcontour.jobs import advise
from armcontour.jobs.advice import with_advice

DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"
CORNER = {
    "name": "corner",
    "arm": "pmk3s",
    "path": {"points": [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]},
    "limits": {"speed": "100 mm/s", "centripetal_acceleration": 0.09},
    "corners": {"tolerance": "2 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"one": {"timing": {"reserve": "5 %"}}},
}
LATE = {"compensation": {"method": "none"}}
ZIGZAG = [[0.30 + 0.02 * k, 0.20 + 0.03 * (k % 2)] for k in range(6)]
SLOW_JOINT = {"limits": {"speed": "1 m/s", "joint_velocity": [0.3, 0.2]}}
SPEED = {"limits": {"speed": "50 mm/s"}}
BOUNDS = [[-0.5, 0.72], [-0.72, 0.6]]
CORNERS = [[0.4, -0.05, 0.2], [0.5, -0.05, 0.2], [0.5, 0.05, 0.2], [0.4, 0.05, 0.2]]
SQUARE = [*CORNERS, CORNERS[0]]
HOLES = "".join(f'<circle cx="{x}" cy="{y}" r="6"/>' for x, y in ((20, 20), (90, 90), (90, 20)))
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="110mm" height="110mm" viewBox="0 0 110 110">'
    f'<g fill="none" stroke="black">{HOLES}</g></svg>'
)
JOBS = {
    "corner": {},
    "own speed": {"runs": {"one": SPEED}},
    "own corners": {"runs": {"one": {"corners": {"tolerance": "0.5 mm"}}}},
    "zigzag": {"path": {"points": ZIGZAG}},
    "zigzag with an accuracy": {"path": {"points": ZIGZAG}, "accuracy": "2.5 mm"},
    "sharp": {"corners": "sharp"},
    "two-sided": {"limits": {**CORNER["limits"], "joint_acceleration": BOUNDS}},
    "fast": {"limits": {"speed": "1 m/s"}, "corners": {"tolerance": "5 mm"}},
    "slow joint": {**SLOW_JOINT, "runs": {"one": LATE}, "accuracy": "15 mm"},
    "slow joint, compensated": SLOW_JOINT,
    "holes": {"path": {"file": "holes.svg", "frame": {"position": [0.28, 0.08, 0]}}},
    "too wide": {"corners": {"tolerance": "10 mm"}, "accuracy": "1 mm"},
    "late": {"runs": {"one": LATE}, "corners": {"tolerance": "0.2 mm"}, "accuracy": "0.21 mm"},
    "soft": {"plant": {"kp": 12}},
    "limited set-points": {
        "arm": "ur5e",
        "path": {"points": SQUARE, "orientation": {"axis": [0, 0, -1]}},
        "limits": {"speed": "250 mm/s"},
        "corners": {"tolerance": "0.25 mm"},
        "cycle": "2 ms",
        "servo": {"kp": 9.75, "kv": 28.5},
        "command_limits": {"joint_velocity": 3.14, "joint_acceleration": 9.42},
        "runs": {"one": {"timing": {"reserve": "2 %"}}},
    },
}
# A controller that reads lines between set-points allows half of their acceleration.
JOBS["lines between set-points"] = {
    **JOBS["limited set-points"],
    "cycle": "4 ms",
    "export": {"formats": ["urscript"]},
}
REPAIRED = ("too wide", "late", "soft", "limited set-points", "lines between set-points")


def run_of(data, folder):
    (folder / "holes.svg").write_text(SVG)
    job = parse_job(yaml.safe_dump(data), folder=folder)
    (run,) = ac.run(job).runs.values()
    return job, run


def changed(data, edits, run="one"):
    """A job with edits, as the Studio and options make them."""
    for key, value in edits:
        data = change_data(data, resolve_patch(data, {key_of(key): value}, run))
    return data


@pytest.mark.parametrize("name", JOBS)
def test_each_suggested_change_saves_the_stated_time(name, tmp_path):
    data = {**CORNER, **JOBS[name]}
    job, result = run_of(data, tmp_path)
    assert result.kept is not (name in REPAIRED)
    advice = advise(job, result)
    assert 0 < len(advice.improvements) <= 3
    saved = [x.saved for x in advice.improvements]
    assert saved == sorted(saved, reverse=True)
    for x in advice.improvements:
        _, after = run_of(changed(data, x.edits), tmp_path)
        assert after.trajectory.duration == pytest.approx(x.duration, rel=1e-12)
        assert x.saved == pytest.approx(result.trajectory.duration - x.duration, rel=1e-12)
        assert after.kept is x.kept
        assert plain(after.to_data())["off_drawing"] == pytest.approx(x.off_drawing, rel=1e-9)
        if name in REPAIRED:
            assert x.kept is True
        else:
            assert x.saved > 0 and x.kept is result.kept


@pytest.mark.parametrize("continuity", [None, "tangent"])
def test_jerk_limit_repairs_tight_corners_that_limited_set_points_cut(continuity):
    data = {**CORNER, **JOBS["limited set-points"]}
    if continuity is not None:
        data["corners"] = {**data["corners"], "continuity": continuity}
    job = parse_job(yaml.safe_dump(data))
    (result,) = ac.run(job).runs.values()
    assert result.kept is False
    fastest = advise(job, result).improvements[0]
    assert fastest.kept is True and fastest.duration <= 2.52
    assert "limits.joint_jerk" in dict(fastest.edits)


def test_lower_speed_is_not_suggested_if_a_reserve_costs_less():
    tight = {"joint_velocity": 3.14, "joint_acceleration": 3.14}
    data = {**CORNER, **JOBS["limited set-points"], "accuracy": "0.5 mm", "command_limits": tight}
    job = parse_job(yaml.safe_dump(data))
    (result,) = ac.run(job).runs.values()
    keys = [{key for key, _ in x.edits} for x in advise(job, result).improvements]
    assert keys == [{"timing.reserve"}, {"timing.reserve", "limits.joint_jerk"}]
    # A lower speed would be kept as well, and take longer than the reserve.
    slow = {**data, "limits": {"speed": "200 mm/s"}}
    (slower,) = ac.run(parse_job(yaml.safe_dump(slow))).runs.values()
    assert slower.kept is True
    assert slower.trajectory.duration > advise(job, result).improvements[0].duration


@needs_dynamics
def test_a_smaller_tolerance_is_suggested_for_corners_outside_the_accuracy(tmp_path):
    text = drawing_text("ur5e", DRAWINGS / "gasket.dxf", tmp_path)
    data = yaml.safe_load(text) | {"corners": {"tolerance": "10 mm"}}
    job, result = run_of(data, tmp_path)
    assert result.kept is False
    improvements = advise(job, result).improvements
    assert [key for x in improvements for key, _ in x.edits] == ["corners.tolerance"]
    _, after = run_of(changed(data, improvements[0].edits, "compensated"), tmp_path)
    assert after.kept is True


def test_suggested_changes_are_in_data_and_text_of_a_job_result(tmp_path):
    job = parse_job(yaml.safe_dump(CORNER))
    job_result = ac.run(job)
    assert "changes" not in plain(job_result.runs["one"].to_data())
    done = with_advice(job_result)
    improvements = done.runs["one"].advice.improvements
    rows = plain(done.figures["one"])["changes"]
    assert [x["saved"] for x in rows] == [x.saved for x in improvements]
    assert [x["edits"] for x in rows] == [plain_edits(x.edits) for x in improvements]
    assert all(x.label in str(done.runs["one"]) for x in improvements)


def plain_edits(edits):
    return [[key, value if np.isscalar(value) else list(value)] for key, value in edits]


@needs_dynamics
def test_a_smaller_reserve_is_suggested_if_it_saves_more_than_a_better_drive(tmp_path):
    text = drawing_text("ur5e", DRAWINGS / "gasket.dxf", tmp_path)
    job, result = run_of(yaml.safe_load(text) | {"servo": CORNER["servo"]}, tmp_path)
    edits = {key: value for x in advise(job, result).improvements for key, value in x.edits}
    assert edits["timing.reserve"] == 0.02
    assert not any("joint" in key for key in edits)


def test_changes_of_long_programs_are_planned_on_request_only():
    points = [[0.30 + 5e-4 * k, 0.20 + 0.01 * (k % 2)] for k in range(200)]
    text = yaml.safe_dump({**CORNER, "path": {"points": points}})
    job_result = ac.run(parse_job(text))
    assert with_advice(job_result).runs["one"].advice is None
