"""The verdict on a run: what is off the drawing, and whether that is within what is allowed."""

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.core.render import plain
from armcontour.io import parse_job

JOB = {
    "name": "corner",
    "arm": "pmk3s",
    "path": {"points": [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]},
    "limits": {"speed": 0.10, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": 2e-3},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "late": {"compensation": {"method": "none"}},
        "shaped": {"corners": {"shape": "free", "tolerance": 1e-3}},
        "sharp": {"corners": "sharp"},
    },
}


def runs_of(**changes):
    return ac.run(parse_job(yaml.safe_dump({**JOB, **changes}))).runs


@pytest.fixture(scope="module")
def runs():
    return runs_of()


def distance_to_lines(points, corners):
    """Distance of points from a polyline, by the definition."""
    found = np.full(len(points), np.inf)
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        found = np.minimum(found, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1))
    return found


@pytest.mark.parametrize("name", ["late", "shaped", "sharp"])
def test_the_tool_is_nowhere_farther_off_the_drawing_than_stated(runs, name):
    run = runs[name]
    stated = plain(run.to_data())["off_drawing"]
    off = distance_to_lines(run.execution.tool, np.array(JOB["path"]["points"]))
    assert off.max() <= stated * (1 + 1e-6) + 1e-9
    rounded = run.rounding_error or 0.0
    assert stated == pytest.approx(rounded + run.evaluation.contour_error.max)


def test_the_accuracy_is_a_tenth_of_the_smallest_tolerance_unless_given(runs):
    assert runs["late"].accuracy == pytest.approx(2e-4) and runs["late"].kept is True
    assert runs["shaped"].accuracy == pytest.approx(1e-4)
    # Without a tolerance and an accuracy there is nothing to keep.
    assert runs["sharp"].accuracy is None and runs["sharp"].kept is None
    late = runs["late"].evaluation.contour_error.max
    for share, kept in ((0.999, False), (1.001, True)):
        run = runs_of(accuracy=float(late * share), runs={"late": JOB["runs"]["late"]})["late"]
        assert run.kept is kept
        assert plain(run.to_data())["kept"] is kept


def test_single_corners_have_the_smallest_tolerance():
    run = runs_of(corners={"tolerance": 2e-3, "at": {2: 5e-4}}, runs={"one": {}})["one"]
    assert run.accuracy == pytest.approx(5e-5)


def test_the_limit_that_binds_for_the_longest_time_is_named(runs):
    why = runs["late"].explanation
    times = {}
    for x in why.bindings:
        times[x.name] = times.get(x.name, 0.0) + x.t[1] - x.t[0]
    times.pop("nothing", None)
    assert runs["late"].to_data()["time_limit"].value == max(times, key=times.get)
