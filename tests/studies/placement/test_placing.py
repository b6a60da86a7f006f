"""Placements: grids, refined places, reach, and the search on workers."""

import random
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core import pool
from armcontour.core.errors import (
    ArmContourError,
    ExecutionError,
    InvalidInput,
    NotRealizable,
    Unreachable,
)
from armcontour.core.pool import InProcess
from armcontour.core.render import number
from armcontour.files import parse_job, placement_csv
from armcontour.robot.scene import ArmShapes, Box, LinkShape, Obstacle, Scene, Sphere
from armcontour.studies.placement import UNITS, Moves
from armcontour.studies.placement.grid_search import index_of_best, search_grid
from armcontour.studies.placement.place_evaluation import CutoffVerdicts, Verdict
from armcontour.studies.placement.screen import PlaceBounds, longest_reach, reach_excess

GRID = {"x": (-0.35, 0.45, 5), "y": (-0.25, 0.25, 3)}
CORNER = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: none}}}
"""
# Plans of a path that is moved differ by this from those in a moved frame: by rounding, which
# decides where grids are refined.
SAME = 1e-5
MIDDLE = np.array([0.53, 0.03, 0.2])


def moved(job, frame):
    """The job with its path moved, where `place` moves the frame that the path is given in."""
    path = ac.Program.from_path(job.path).placed(frame).single_path
    return replace(job, path=path)


def plan(job):
    (run,) = job.runs
    path = ac.round_corners(job.path, tolerance=run.rounding.tolerance)
    return ac.plan(path, job.arm, run.limits, replace(run.timing, seed=job.seed))


def durations(placement, job, anchor):
    """Durations of all places by brute force; infinite where there is no plan."""
    expected = []
    for k in range(len(placement.verdicts)):
        frame = Moves(anchor=anchor).frame(placement.place(k))
        try:
            expected.append(plan(moved(job, frame)).duration)
        except ArmContourError:
            expected.append(np.inf)
    return np.array(expected)


@pytest.fixture(scope="module")
def placed(square):
    return ac.place(square, ac.PlaceSearch(over=GRID))


@pytest.fixture(scope="module")
def brute(square, placed):
    return durations(placed, square, MIDDLE)


def test_the_best_of_the_grid_is_that_of_all_plans(placed, brute):
    k = int(np.argmin(brute))
    assert placed.best.values == placed.place(k)
    assert placed.best.verdict.duration == pytest.approx(brute[k], rel=SAME)
    # The bounds spare most plans, hold everywhere, and are no empty ones.
    assert placed.planned < np.isfinite(brute).sum() / 2
    bounds = placed.values("bound").ravel()
    finite = np.isfinite(brute)
    assert (bounds[finite] <= brute[finite]).all() and (bounds[finite] > 0.9 * brute[finite]).all()
    refused = np.array([bool(x.refusal) for x in placed.verdicts])
    assert refused.any() and not refused.all()
    assert (refused == np.isinf(brute)).all()
    assert placed.refusals == {"reach": int(refused.sum())}


def test_a_refined_place_is_better_and_planned_in_full(placed, square):
    refined, best = placed.refined, placed.best
    assert refined.verdict.duration < best.verdict.duration < placed.own.duration
    assert placed.own.duration == pytest.approx(plan(square).duration, rel=1e-12)
    for name, (low, high, _) in GRID.items():
        assert low <= refined.values[name] <= high
    again = plan(moved(square, Moves(anchor=MIDDLE).frame(refined.values)))
    assert refined.verdict.duration == pytest.approx(again.duration, rel=SAME)
    # The job with its part there has that plan.
    assert plan(placed.placed()).duration == refined.verdict.duration
    # The verdict compares both places, in the units of people.
    shown, data = str(placed), placed.to_data()
    for name, value in refined.values.items():
        assert f"{name} {number(value, UNITS[name])}" in shown
    for name, verdict in ("best", refined.verdict), ("own_place", placed.own):
        row = data[f"{name}.duration"]
        assert row.value == verdict.duration and number(row.value, row.unit) in shown
    assert data["gain"].value == 1 - refined.verdict.duration / placed.own.duration > 0


def test_every_place_can_be_planned(square):
    over = {"z": (0.0, 0.1, 2), "tilt": (-0.2, 0.2, 2)}
    placement = ac.place(square, ac.PlaceSearch(over=over, every=True, refined=False))
    assert placement.planned == 4 and placement.refined is placement.best
    expected = durations(placement, square, MIDDLE)
    np.testing.assert_allclose(placement.values("duration").ravel(), expected, rtol=SAME)
    # Torques at random times leave at least that margin, and some leave little more.
    trajectory = plan(placement.placed())
    t = np.linspace(0, trajectory.duration, 2000)
    limits = placement.run.limits.joint_torque
    used = np.abs(square.arm.torque(*(trajectory(t, k) for k in range(3)))) / limits
    assert placement.best.verdict.torque_margin == pytest.approx(1 - used.max(), abs=2e-3)


def test_the_worst_corner_counts(square):
    uncertainty = {"x": 0.02, "yaw": 0.1}
    placement = ac.place(
        square, ac.PlaceSearch(over={"x": (0.0, 0.1, 2)}, uncertainty=uncertainty, refined=False)
    )
    plain = ac.place(square, ac.PlaceSearch(over={"x": (0.0, 0.1, 2)}, refined=False))

    def worst(x):
        frames = [
            Moves(anchor=MIDDLE).frame({"x": x + a, "yaw": b})
            for a, b in [(0, 0), *((a, b) for a in (-0.02, 0.02) for b in (-0.1, 0.1))]
        ]
        return max(plan(moved(square, frame)).duration for frame in frames)

    expected = [worst(0.0), worst(0.1)]
    assert placement.best.verdict.duration == pytest.approx(min(expected), rel=SAME)
    assert placement.best.values["x"] == (0.0, 0.1)[int(np.argmin(expected))]
    assert placement.best.verdict.duration > plain.best.verdict.duration
    over = {"x": (0.0, 0.2, 2)}
    placement = ac.place(
        square, ac.PlaceSearch(over=over, uncertainty={"x": 0.2}, every=True, refined=False)
    )
    assert placement.refusals == {"reach": 1} and placement.best.values == {"x": 0.0}


def test_the_largest_manipulability_is_found(square):
    placement = ac.place(
        square,
        ac.PlaceSearch(over={"x": (-0.2, 0.2, 3)}, objective="manipulability", refined=False),
    )
    values = []
    for k in range(3):
        job = moved(square, Moves(anchor=MIDDLE).frame(placement.place(k)))
        trajectory = plan(job)
        q = trajectory(np.linspace(0, trajectory.duration, 500))
        point, turned = job.arm.pose(q)
        # The Jacobian by differences of poses.
        columns = []
        for j in range(6):
            step = 1e-6 * np.eye(6)[j]
            after, turned_after = job.arm.pose(q + step)
            spin = (turned_after @ np.swapaxes(turned, 1, 2))[:, [2, 0, 1], [1, 2, 0]] / 1e-6
            columns.append(np.concatenate([(after - point) / 1e-6, spin], axis=1))
        jacobian = np.stack(columns, axis=2)
        values.append(np.linalg.svd(jacobian, compute_uv=False)[:, -1].min())
    k = int(np.argmax(values))
    assert placement.best.values == placement.place(k)
    assert placement.best.verdict.singular == pytest.approx(values[k], rel=1e-3)


def with_ball(job, *obstacles):
    """The job with a ball as the arm's tool, among obstacles."""
    ball = LinkShape(name="ball", link=6, shape=Sphere(radius=0.02), tool=True)
    arm = job.arm.with_shapes(ArmShapes(shapes=(ball,)))
    return replace(job, arm=arm, scene=Scene(obstacles=obstacles))


def post(fixed_to, x):
    """A post beside the path, whose end at the start of the path is at (0.5, 0.0)."""
    size, place = Box(size=[0.01, 0.01, 1.0]), ac.Frame(position=[x, -0.05, 0.0])
    return Obstacle(name="post", shape=size, place=place, fixed_to=fixed_to)


@needs_dynamics
def test_obstacles_of_the_cell_refuse_places_and_those_of_the_part_move_with_it(square):
    search = ac.PlaceSearch(over={"y": (-0.05, 0.0, 2)}, refined=False)
    cell = ac.place(with_ball(square, post("base", 0.53)), replace(search, every=True))
    assert [x.refusal for x in cell.verdicts] == ["clearance", ""]
    assert "post" in cell.verdicts[0].reason
    # The ball runs along y = 0: 50 mm from the post's middle, less 5 and 20 mm.
    assert cell.best.verdict.clearance == pytest.approx(0.025, abs=1.1e-3)
    clear = replace(search, objective="clearance")
    part = ac.place(with_ball(square, post("part", 0.53)), clear)
    np.testing.assert_allclose(part.values("clearance"), 0.025, atol=1.1e-3)
    # A base that moves leaves both behind.
    moved_base = replace(search, what="base", every=True)
    base = ac.place(with_ball(square, post("base", 0.53)), moved_base)
    np.testing.assert_allclose(base.values("clearance"), 0.025, atol=1.1e-3)


def test_a_base_that_moves_sees_the_part_move_back(square):
    one = {"x": (0.1, 0.1, 1), "yaw": (0.3, 0.3, 1)}
    placement = ac.place(square, ac.PlaceSearch(over=one, what="base", refined=False))
    frame = Moves(anchor=np.zeros(3)).frame({"x": 0.1, "yaw": 0.3})
    expected = plan(moved(square, frame.inverse)).duration
    assert placement.best.verdict.duration == pytest.approx(expected, rel=SAME)
    assert plan(placement.placed()).duration == placement.best.verdict.duration


def test_an_arm_in_the_plane_is_placed_too(plane):
    over = {"x": (-0.04, 0.04, 3), "yaw": (-0.5, 0.5, 2)}
    placement = ac.place(plane, ac.PlaceSearch(over=over, refined=False))
    expected = durations(placement, plane, np.array([0.33, 0.22, 0.0]))
    assert placement.best.values == placement.place(int(np.argmin(expected)))
    assert placement.best.verdict.duration == pytest.approx(expected.min(), rel=SAME)
    assert plan(placement.placed()).duration == pytest.approx(expected.min(), rel=SAME)


@needs_dynamics
def test_without_a_feasible_place_the_distance_out_of_reach_is_reported(square):
    with pytest.raises(
        Unreachable, match=r"None of 4 places is feasible \(refused: 4 by reach\)"
    ) as caught:
        ac.place(square, ac.PlaceSearch(over={"x": (1.0, 2.0, 4)}))
    # The corner of the path that is the farthest from the base.
    assert 0.5 < caught.value.needed < 1.0
    with pytest.raises(Unreachable, match=r"The place x 1000 mm is not feasible: .* stays .* away"):
        ac.place(square, ac.PlaceSearch(over={"x": (1.0, 1.0, 1)}))
    with pytest.raises(Unreachable, match="a corner of its uncertainty is refused by reach"):
        ac.place(square, ac.PlaceSearch(over={"x": (0.2, 0.2, 1)}, uncertainty={"x": 0.3}))
    with pytest.raises(NotRealizable, match="by clearance.*post"):
        ac.place(
            with_ball(square, post("base", 0.5)), ac.PlaceSearch(over={"y": (-0.06, -0.04, 2)})
        )


def test_wrong_wishes_are_refused(square):
    (run,) = square.runs
    slow = replace(square, runs=(replace(run, timing=ac.Optimal(duration=5.0)),))
    for job, wrong, words in (
        (square, {"objective": "beauty"}, "must be one of duration, manipulability"),
        (square, {"objective": "clearance"}, "those of UR5e are"),
        (square, {"run": "first"}, "no run 'first'. Its runs are compensated"),
        (square, {"what": "base", "about": "origin"}, "about its own origin"),
        (square, {"what": "base", "over": {"tilt": (0, 1, 2)}}, "A base cannot be tilted"),
        (square, {"processes": 0}, "processes"),
        (slow, {}, "specified duration of 5 s"),
        (parse_job(CORNER), {"over": {}}, "use the key placement.over"),
    ):
        processes = wrong.pop("processes", None)
        with pytest.raises(InvalidInput, match=words):
            search = ac.PlaceSearch(**{"over": {"x": (0, 0.1, 2)}, **wrong})
            ac.place(job, search, processes=processes)


def test_the_job_holds_the_question():
    question = (
        "placement: {over: {x: {from: 0 mm, to: 20 mm, places: 2}}, refine: false, about: origin}\n"
    )
    from_job = ac.place(parse_job(CORNER + question))
    from_options = ac.place(
        parse_job(CORNER), ac.PlaceSearch(over={"x": (0.0, 0.02, 2)}, refined=False, about="origin")
    )
    # Figures that are not computed are NaN, which equals nothing.
    assert (
        repr(from_job.verdicts) == repr(from_options.verdicts)
        and from_job.refined.values == from_options.refined.values
    )
    assert from_job.moves.anchor.tolist() == [0, 0, 0] == from_options.moves.anchor.tolist()
    search = ac.PlaceSearch(over={"yaw": (0.0, 0.1, 2)}, about=(0.3, 0.2, 0.0))
    other = ac.place(parse_job(CORNER + question), search)
    assert [x.name for x in other.axes] == ["yaw"]
    assert other.moves.anchor.tolist() == [0.3, 0.2, 0.0]


def test_a_note_reports_a_best_place_at_the_end_of_a_range(square):
    wide = ac.place(square, ac.PlaceSearch(over={"x": (-0.2, 0.2, 3)}, refined=False))
    inside = wide.refined.values["x"] == 0.0
    assert inside == (not any("at the end of the range of x" in x for x in wide.notes))
    # A range that lies beside its best place ends there.
    best = wide.refined.values["x"]
    for first, last in ((best + 0.02, best + 0.06), (best - 0.06, best - 0.02)):
        placement = ac.place(square, ac.PlaceSearch(over={"x": (first, last, 2)}, refined=False))
        (note,) = (x for x in placement.notes if "range" in x)
        assert note.startswith("The best place is at the end of the range of x. A wider range")


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "panda"])
@pytest.mark.parametrize("task", [5, 6])
def test_no_posture_leaves_the_ball(name, task):
    arm = ac.load_arm(name).with_tool(ac.Frame(position=[0.02, 0.0, 0.1]))
    rng = np.random.default_rng(1)
    points, rotations = arm.pose(rng.uniform(-np.pi, np.pi, (20_000, arm.dof)))
    point, middle, radius = longest_reach(arm.chain, task)
    far = np.linalg.norm(points + rotations @ point - middle, axis=1)
    # Nor is the ball much too large: a bound of the sum of all offsets would be.
    assert 0.8 * radius < far.max() <= radius + 1e-12


def test_distances_beyond_are_those_of_the_farthest_pose():
    arm = ac.load_arm("ur5e")
    _, middle, radius = longest_reach(arm.chain, 5)
    poses = np.zeros((2, 3, 4))
    poses[:, :, :3] = np.eye(3)
    poses[:, :, 3] = middle + np.array([[0.1, 0, 0], [2.0, 0, 0]])
    bases = np.zeros((2, 3, 4))
    bases[:, :, :3] = np.eye(3)
    bases[1, 0, 3] = 0.5
    np.testing.assert_allclose(reach_excess(arm.chain, 5, poses, bases), [2 - radius, 1.5 - radius])


class Untidy(Executor):
    """Works on what it was given when somebody waits for it, in any order."""

    _max_workers = 4

    def __init__(self, seed):
        self.random, self.waiting, self.count = random.Random(seed), [], 0

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.count += 1
        self.waiting.append((future, fn, args))
        return future

    def wait(self, futures, **more):
        """Do one piece of work or several, in place of waiting for them."""
        for _ in range(self.random.randint(1, len(self.waiting))):
            future, fn, args = self.waiting.pop(self.random.randrange(len(self.waiting)))
            if future.set_running_or_notify_cancel():
                future.set_result(fn(*args))


def untidily(seed, call, **options):
    """The result of a call with an executor that answers in any order, and its pieces of work."""
    executor = Untidy(seed)
    with patch.object(pool, "wait_for", executor.wait):
        return call(executor=executor, **options), executor.count


FEW = {"x": (-0.1, 0.1, 3)}


@dataclass(frozen=True)
class Known:
    """Evaluates places with known bounds and durations; some bounds may be wrong."""

    bounds: tuple[float, ...]
    durations: tuple[float, ...]
    screen: Any = True
    objective: str = "duration"

    def bounds_of(self, places):
        return [
            PlaceBounds(refusal="reach")
            if np.isinf(self.durations[int(x["x"])])
            else PlaceBounds(duration=self.bounds[int(x["x"])])
            for x in places
        ]

    def least_score(self, verdict):
        return verdict.duration

    def evaluate(self, place, cutoff):
        k = int(place["x"])
        bound = Verdict(bound=self.bounds[k])
        steps = [(self.bounds[k], bound), (self.bounds[k] + 0.5, Verdict(bound=bound.bound + 0.5))]
        for i, x in enumerate(steps):
            if x[0] > cutoff:
                return CutoffVerdicts(tuple(steps[: i + 1]))
        return CutoffVerdicts((*steps, (np.inf, Verdict(duration=self.durations[k]))))


places = st.lists(
    st.tuples(st.integers(1, 9), st.sampled_from([-2, 0, 0.5, 1, 3, np.inf])),
    min_size=1,
    max_size=40,
)


@example([(1, 0.5), (1, -2)], False, 0)
@given(places, st.booleans(), st.integers(0, 99))
def test_the_order_of_answers_changes_nothing(candidates, every, seed):
    judge = Known(
        tuple(float(b) for b, _ in candidates), tuple(float(b + more) for b, more in candidates)
    )
    grid = [{"x": float(k)} for k in range(len(candidates))]
    tell = []
    alone = search_grid(
        judge, grid, every=every, processes=1, progress=lambda x: tell.append(x.done)
    )
    shuffled = partial(search_grid, judge, grid, every=every, progress=lambda x: None)
    shuffled_result, _ = untidily(seed, shuffled)
    # As text, as what is unknown is not a number.
    assert str(shuffled_result) == str(alone)
    if all(more >= 0.5 for _, more in candidates):
        # With bounds that hold the best is that of all.
        best = index_of_best(alone, "duration")
        finite = [x for x in judge.durations if np.isfinite(x)]
        assert (best is None) == (not finite)
        assert best is None or judge.durations[best] == min(finite)
    assert tell[-1] == 1.0


@pytest.mark.parametrize(
    "more",
    [
        {"over": {"x": (-0.35, 0.45, 5), "y": (-0.25, 0.25, 3)}},
        {"uncertainty": {"x": 2e-3}, "over": FEW},
        {"objective": "manipulability", "over": FEW},
        {"every": True, "over": FEW},
    ],
)
def test_the_table_is_the_same_byte_for_byte(square, more):
    search = ac.PlaceSearch(refined=False, **more)
    alone = ac.place(square, search, processes=1)
    placement, count = untidily(3, partial(ac.place, square, search))
    assert placement_csv(placement) == placement_csv(alone) and count > 1
    assert placement.best.values == alone.best.values and str(placement) == str(alone)


class Losing(InProcess):
    """Loses its worker after some work."""

    def __init__(self, after):
        self.left = after

    def submit(self, fn, /, *args, **kwargs):
        self.left -= 1
        if self.left >= 0:
            return super().submit(fn, *args, **kwargs)
        future = Future()
        future.cancel()
        return future


def test_a_lost_worker_is_an_error(square, refuses):
    lost = "A worker of the executor ended before"
    for after in (0, 2):
        with pytest.raises(ExecutionError, match=lost):
            ac.place(square, ac.PlaceSearch(over=FEW), executor=Losing(after))
    with pytest.raises(InvalidInput, match="an executor has its own workers"):
        ac.place(square, ac.PlaceSearch(over=FEW), executor=InProcess(), processes=2)
