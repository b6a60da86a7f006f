"""Placements compared with plans of the moved path; obstacles, bases and refusals."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.errors import ArmContourError, InvalidInput, NotRealizable
from armcontour.core.render import number
from armcontour.files import parse_job, placement_csv
from armcontour.robot.scene import ArmShapes, Box, LinkShape, Obstacle, Scene, Sphere
from armcontour.studies.placement import displacement

SQUARE = """
name: square
arm: ur5e
path:
  points: [[0.5, 0.0, 0.2], [0.56, 0.0, 0.2], [0.56, 0.06, 0.2], [0.5, 0.0, 0.2]]
  orientation: {quaternion: [1, 0, 0, 0]}
limits: {speed: 0.25 m/s}
corners: {tolerance: 0.25 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {compensation: {method: inverse}}}
"""
PLANE = """
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: pole_placement}}}
"""
# Plans of a path that is moved differ by this from those in a moved frame: by rounding, which
# decides where grids are refined.
SAME = 1e-5
MIDDLE = np.array([0.53, 0.03, 0.2])
NUMBERS = st.floats(-2, 2)


@pytest.fixture(scope="module")
def square():
    """Without shapes of the links, so that nothing but limits refuses a place."""
    job = parse_job(SQUARE)
    return replace(job, arm=job.arm.with_shapes(None))


def moved(job, frame):
    """The job with its path moved, where `place` moves the frame that the path is given in."""
    path = ac.Program.from_path(job.path).placed(frame).single_path
    return replace(job, path=path)


def plan(job):
    (run,) = job.runs
    path = ac.round_corners(job.path, tolerance=run.rounding.tolerance)
    return ac.plan(path, job.arm, run.limits, replace(run.timing, seed=job.seed))


def durations(placement, job, anchor):
    """Durations of all places by brute force; NaN where there is no plan."""
    expected = []
    for place in placement.places:
        try:
            expected.append(plan(moved(job, displacement(place.values, anchor))).duration)
        except ArmContourError:
            expected.append(np.nan)
    return np.array(expected)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.lists(NUMBERS, min_size=3, max_size=3))
def test_yaw_turns_about_the_anchor_and_lengths_move_it(x, y, z, yaw, anchor):
    a = np.array(anchor)
    frame = displacement({"x": x, "y": y, "z": z, "yaw": yaw}, a)
    np.testing.assert_allclose(frame.position + frame.rotation @ a, a + [x, y, z], atol=1e-12)
    turned = [np.cos(yaw), np.sin(yaw), 0.0]
    np.testing.assert_allclose(frame.rotation[:, 0], turned, atol=1e-12)


def test_every_position_has_the_duration_of_its_own_plan(square):
    grid = {"x": np.linspace(-0.35, 0.45, 5), "y": [-0.25, 0.25], "yaw": [0.0, 0.5]}
    progress_log = []
    placement = ac.place(square, grid, processes=1, progress=progress_log.append)
    expected = durations(placement, square, MIDDLE)
    np.testing.assert_allclose(placement.durations.ravel(), expected, rtol=SAME)
    assert placement.durations.shape == (5, 2, 2)
    k = int(np.nanargmin(expected))
    assert placement.best is placement.places[k]
    assert placement.own.duration == pytest.approx(plan(square).duration, rel=1e-12)
    assert plan(placement.placed()).duration == placement.best.duration
    refused = [x for x in placement.places if x.duration is None]
    assert placement.refusals == {"reach": len(refused)} and 0 < len(refused) < 20
    assert all("tool stays" in x.why_not for x in refused)
    assert 0 < progress_log[-1].done < 1
    # The printed summary has the units of people.
    shown = str(placement)
    gain = 1 - placement.best.duration / placement.own.duration
    assert str(placement.best) in shown and number(placement.best.duration, "s") in shown
    assert placement.to_data()["gain"].value == gain > 0


@pytest.mark.parametrize(
    "process",
    [
        "{approach_speed: 0.2 m/s}",
        "{approach_speed: 0.2 m/s, lead_in: {length: auto}}",
        "{approach_speed: 0.2 m/s, only: [2]}",
    ],
)
def test_every_position_is_planned_as_its_own_job(process):
    """Programs do not depend on the place, except for automatic leads and parts of a program."""
    job = parse_job(f"{SQUARE}process: {process}\n")
    beside = displacement({"y": 0.1, "yaw": 0.3}, MIDDLE)
    first = ac.Program.from_path(job.path)
    second = [replace(x, number=2) for x in first.placed(beside).moves]
    job = replace(job, path=ac.Program(moves=(*first.moves, *second)))
    placement = ac.place(job, {"x": [-0.05, 0.05], "yaw": [0.4]}, processes=1)
    for place in placement.places:
        alone = ac.run(placement.placed(place))
        (planned,) = alone.runs.values()
        assert place.duration == planned.trajectory.duration
        assert place.clearance == planned.clearance.low


def test_workers_and_executors_return_the_same_results(square):
    job = parse_job(PLANE)
    grid = {"x": np.linspace(-0.04, 0.04, 5), "yaw": [-0.5, 0.0, 0.5]}
    alone = ac.place(job, grid, processes=1)
    with ThreadPoolExecutor(3) as threads:
        placement = ac.place(job, grid, executor=threads)
    pool = ac.place(job, grid, processes=2)
    assert placement_csv(placement) == placement_csv(pool) == placement_csv(alone)


def test_shapes_of_the_arm_are_read_once_for_all_places(square):
    reads = []

    def read():
        reads.append(1)
        hand = LinkShape(name="hand", link=6, shape=Sphere(radius=0.01), place=ac.Frame())
        return ArmShapes(shapes=(hand,))

    job = replace(square, arm=square.arm.with_shapes(read))
    assert all(x.duration for x in ac.place(job, {"x": [0.0, 0.01]}, processes=1).places)
    assert len(reads) == 1


def test_placement_supports_planar_arms():
    plane = parse_job(PLANE)
    placement = ac.place(plane, {"x": [-0.04, 0.0, 0.04], "yaw": [-0.5, 0.5]}, processes=1)
    expected = durations(placement, plane, np.array([0.33, 0.22, 0.0]))
    np.testing.assert_allclose(placement.durations.ravel(), expected, rtol=SAME)
    assert plan(placement.placed()).duration == pytest.approx(expected.min(), rel=SAME)


def test_moving_the_base_is_equivalent_to_moving_the_part_back(square):
    placement = ac.place(square, {"x": [0.1], "yaw": [0.3]}, move="base", processes=1)
    frame = displacement({"x": 0.1, "yaw": 0.3}, np.zeros(3))
    expected = plan(moved(square, frame.inverse)).duration
    assert placement.best.duration == pytest.approx(expected, rel=SAME)
    assert plan(placement.placed()).duration == placement.best.duration


def with_ball(job, *obstacles):
    """The job with a ball as the arm's tool, among obstacles."""
    ball = LinkShape(name="ball", link=6, shape=Sphere(radius=0.02), tool=True)
    arm = job.arm.with_shapes(ArmShapes(shapes=(ball,)))
    return replace(job, arm=arm, scene=Scene(obstacles=obstacles))


def post(fixed_to, x):
    """A post next to the path, which starts and ends at (0.5, 0.0)."""
    size = Box(size=[0.01, 0.01, 1.0])
    place = ac.Frame(position=[x, -0.05, 0.0])
    return Obstacle(name="post", shape=size, place=place, fixed_to=fixed_to)


@needs_dynamics
def test_obstacles_of_the_cell_exclude_positions_and_those_of_the_part_move(square):
    grid = {"y": [-0.05, 0.0]}
    cell = ac.place(with_ball(square, post("base", 0.53)), grid, processes=1)
    assert [x.refusal for x in cell.places] == ["clearance", ""]
    assert "post" in cell.places[0].why_not
    # The ball runs along y = 0: 50 mm from the post's middle, less 5 and 20 mm.
    assert cell.best.clearance == pytest.approx(0.025, abs=1.1e-3)
    part = ac.place(with_ball(square, post("part", 0.53)), grid, processes=1)
    # A base that moves leaves both behind.
    base = ac.place(with_ball(square, post("base", 0.53)), grid, move="base", processes=1)
    for placement in (part, base):
        clearances = [x.clearance for x in placement.places]
        np.testing.assert_allclose(clearances, 0.025, atol=1.1e-3)


def test_a_grid_without_a_feasible_position_is_a_result(square):
    placement = ac.place(square, {"x": [1.0, 2.0]}, processes=1)
    assert placement.best is None and placement.refusals == {"reach": 2}
    assert "No position of the grid is feasible." in placement.to_data().notes
    with pytest.raises(NotRealizable, match="No position of the grid is feasible"):
        placement.placed()


def test_invalid_placement_grids_are_refused(square):
    plane = parse_job(PLANE)
    for job, grid, more, words in (
        (square, {"tilt": [0.0]}, {}, "no axis 'tilt'. Its axes are x, y, z, yaw"),
        (plane, {"z": [0.0]}, {}, "no axis 'z'. Its axes are x, y, yaw"),
        (square, {}, {}, "The grid has no positions"),
        (square, {"x": []}, {}, "The grid has no positions|axis x"),
        (square, {"x": 0.1}, {}, "The axis x of the grid must be a list"),
        (square, {"x": [np.nan]}, {}, "axis x"),
        (square, {"x": [0.0]}, {"run": "first"}, "no run 'first'. Its runs are compensated"),
        (square, {"x": [0.0]}, {"move": "table"}, "must be one of part, base"),
    ):
        with pytest.raises(InvalidInput, match=words):
            ac.place(job, grid, **more)
