"""The verdict on a run: deviation from the drawing, and the allowed deviation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core import render
from armcontour.core.render import plain
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.jobs import rows
from armcontour.jobs.advice import with_advice
from armcontour.jobs.verdict import Errors

DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"
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
    distances = np.full(len(points), np.inf)
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        distances = np.minimum(
            distances, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)
        )
    return distances


@pytest.mark.parametrize("name", ["late", "shaped", "sharp"])
def test_the_stated_distance_from_the_drawing_is_not_exceeded(runs, name):
    run = runs[name]
    stated = plain(run.to_data())["off_drawing"]
    corners = np.array(JOB["path"]["points"])
    tool = run.execution.tool
    deviations = distance_to_lines(tool, corners)
    moves = np.append((tool[1:] != tool[:-1]).any(axis=1), True)
    missed = distance_to_lines(corners, tool[moves])
    assert max(deviations.max(), missed.max()) == pytest.approx(stated, abs=2e-8)
    # It is at most the sum of the largest parts, and they are at different places.
    rounded = run.rounding_error or 0.0
    e = run.evaluation
    assert stated <= rounded + max(e.contour_error.max, e.coverage_error.max) + 1e-12
    assert e.off_drawing == stated
    # A part that contour errors do not contain is named.
    missed = "a point of the drawing is missed" in run.to_data()["off_drawing"].note
    assert missed is bool(stated > (rounded + e.contour_error.max) * 1.001)


def allowed(run):
    return plain(run.to_data())["contour_error_allowed"]


def test_the_default_accuracy_is_a_tenth_of_the_smallest_tolerance(runs):
    assert allowed(runs["late"]) == pytest.approx(2e-4) and runs["late"].kept is True
    assert allowed(runs["shaped"]) == pytest.approx(1e-4)
    # Without a tolerance and an accuracy there is nothing to keep.
    assert allowed(runs["sharp"]) is None and runs["sharp"].kept is None
    assert "kept" not in [x.name for x in runs["sharp"].to_data().shown()]


def test_order_of_the_rows_does_not_change_the_verdict(monkeypatch):
    allowed_error = 1e-6
    before = runs_of(accuracy=allowed_error)
    original = rows.verdict_rows
    # The verdict is the first of the rows, so that each other row is first once.
    for first in range(len([*original(before["late"], before["late"].verdict)])):

        def turned(result, verdict, first=first):
            found = [*original(result, verdict)]
            return iter([*found[first:], *found[:first]])

        monkeypatch.setattr(rows, "verdict_rows", turned)
        for name, result in runs_of(accuracy=allowed_error).items():
            assert result.kept is before[name].kept is False
            data = result.to_data()
            assert data["kept"].value is False
            assert data["off_drawing"].value == result.verdict.off_drawing
            assert "NOT KEPT" in render.verdict(data)
            assert plain(data) == plain(before[name].to_data())


def test_a_changed_result_is_judged_anew(runs):
    result = runs["late"]
    assert result.kept is True
    stricter = replace(result, run=replace(result.run, accuracy=1e-6))
    assert stricter.kept is False and stricter.verdict.requirement == "accuracy"
    measured = result.judge({"measured": Errors(contour=[1.0])})
    assert measured.kept is False and measured.off_drawing == 1.0 + result.rounding_error
    planned = replace(result, execution=None, evaluation=None)
    assert planned.kept is None and planned.verdict.off_drawing is None


@pytest.mark.parametrize("name", ["late", "sharp"])
def test_the_accuracy_limits_the_distance_of_the_tool_from_the_drawing(runs, name):
    deviation = plain(runs[name].to_data())["off_drawing"]
    for share, within in ((0.999, False), (1.001, True)):
        run = runs_of(accuracy=float(deviation * share), runs={name: JOB["runs"].get(name)})[name]
        assert run.kept is within
        data = run.to_data()
        assert plain(data)["kept"] is within and plain(data)["off_drawing"] == deviation
        (shown,) = (x for x in render.frame(data) if x["name"] == "kept")
        word = "kept" if within else "NOT KEPT"
        assert (shown["value"], shown["text"]) == (within, f"{word}, as modelled")
        assert render.verdict(data).startswith(f"Run {name}: {shown['text']} (")


@needs_dynamics
def test_corners_outside_the_accuracy_of_the_drawing_are_not_kept():
    patch = {("corners", "tolerance"): 10e-3}
    (run,) = ac.run(read_cell("ur5e", DRAWINGS / "gasket.dxf", patch=patch)).runs.values()
    data = run.to_data()
    assert run.kept is False and data["off_drawing"].value == pytest.approx(3.19e-3, abs=1e-5)
    assert "NOT KEPT" in render.verdict(data) and "3.19 mm" in render.verdict(data)
    # What takes the time adds up to it.
    time = plain(data)["time"]
    assert sum(x["time"] for x in time) == pytest.approx(run.trajectory.duration, rel=1e-12)
    assert sum(x["of_time"] for x in time) == pytest.approx(1, rel=1e-12)
    rapids = next(x for x in time if x["kind"] == "rapids between contours")
    assert rapids["time"] == pytest.approx(plain(data)["rapid_time"], rel=1e-12)


def test_the_result_names_the_limit_that_is_active_longest(runs):
    why = runs["late"].explanation
    times = {}
    for x in why.bindings:
        times[x.name] = times.get(x.name, 0.0) + x.t[1] - x.t[0]
    times.pop("nothing", None)
    assert runs["late"].to_data()["time_limit"].value == max(times, key=times.get)


@needs_dynamics
def test_the_distance_of_a_program_from_the_drawing_is_that_of_its_worst_contour():
    (run,) = ac.run(read_cell("ur5e", DRAWINGS / "gasket.dxf")).runs.values()
    distances = [x.max for x in run.evaluation.drawing_errors]
    assert run.verdict.off_drawing == distances[run.verdict.contour] == max(distances)
    # If only contour errors are known, the deviation of the path is added.
    errors = [x.max for x in run.evaluation.contours]
    sums = [x.total + y for x, y in zip(run.deviations, errors, strict=True)]
    assert max(distances) <= max(sums)
    assert run.judge({"measured": Errors(contour=errors)}).off_drawing == max(sums)


def limited_run(**changes):
    """A run whose plan moves both joints at their largest velocity, 0.3 rad/s.

    Jumps of acceleration let the set-points of its slow velocity loops exceed that velocity.
    """
    keys = {
        "limits": {**JOB["limits"], "joint_velocity": 0.3},
        "accuracy": 3e-3,
        "servo": {"kp": 10, "kv": 30},
        "runs": {"one": {}},
    }
    (run,) = runs_of(**{**keys, **changes}).values()
    return run


def excess_of_set_points(run):
    """How much faster than 0.3 rad/s the set-points move, by their definition [rad/s]."""
    return np.abs(np.diff(run.set_points.q, axis=0)).max() / run.set_points.cycle - 0.3


def test_compensated_set_points_keep_the_joint_velocity():
    run = limited_run()
    assert excess_of_set_points(run) < 1e-9 and run.kept is True
    assert run.verdict.violations == () and "joint_velocity" not in str(run.verdict)


def test_a_run_with_set_points_above_a_joint_velocity_is_not_kept():
    """Set-points that are not compensated are those of the plan, which the controller refuses."""
    late = {"runs": {"one": {"compensation": {"method": "none"}}}, "accuracy": 20e-3}
    assert limited_run(**late).kept is True
    late["command_limits"] = {"joint_velocity": 0.29}
    run = limited_run(**late)
    assert excess_of_set_points(run) < 1e-6 and run.verdict.off_drawing < 20e-3
    assert run.kept is False and run.verdict.requirement == "limits"
    # The verdict tells what is violated, and what is kept.
    data = run.to_data()
    assert data["kept"].value is False
    assert "joint_velocity" in data["kept"].note and "20 mm" in data["kept"].note
    assert sum("command_limits" in x for x in run.warnings) == 1
    # Another requirement that is violated comes first; the limit is named as well.
    both = limited_run(**{**late, "accuracy": 1e-6})
    assert (
        both.verdict.requirement == "accuracy" and "joint_velocity" in both.to_data()["kept"].note
    )
    # Without an allowed error, the limit alone decides.
    sharp = limited_run(**{**late, "accuracy": None, "corners": "sharp"})
    assert sharp.kept is False and sharp.verdict.requirement == "limits"


def test_a_run_with_set_points_beyond_a_joint_range_is_not_kept():
    (free,) = runs_of(accuracy=3e-3, runs={"one": {}}).values()
    assert free.kept is True
    times = np.linspace(0, free.trajectory.duration, 5000)
    planned = free.trajectory(times)[:, 1].max()
    commanded = free.set_points.q[:, 1].max()
    assert commanded > planned
    upper = float((planned + commanded) / 2)
    limits = {**JOB["limits"], "joint_upper": [3.0, upper]}
    (run,) = runs_of(limits=limits, accuracy=3e-3, runs={"one": {}}).values()
    assert run.trajectory.duration == pytest.approx(free.trajectory.duration, rel=1e-9)
    assert run.kept is True and (run.set_points.q[:, 1] <= upper).all()
    (late,) = runs_of(
        command_limits={"joint_upper": [3.0, float(planned) - 1e-3]},
        accuracy=20e-3,
        runs={"one": {"compensation": {"method": "none"}}},
    ).values()
    assert late.kept is False and late.verdict.requirement == "limits"


@needs_dynamics
def test_a_run_that_comes_too_near_to_an_obstacle_in_the_execution_is_not_kept():
    """The servo overshoots the end of the line, behind which is a post."""
    post = {"type": "box", "name": "post", "at": [0.46, 0.20, 0], "size": [0.01, 0.01, 0.1]}

    def run_with(margin):
        (run,) = runs_of(
            path={"points": [[0.30, 0.20], [0.40, 0.20]]},
            limits={"speed": 0.25},
            plant={"kp": 25, "kv": 30},
            scene={"obstacles": [post], "margins": {"environment": margin}},
            accuracy=20e-3,
            runs={"one": {"compensation": {"method": "none"}}},
        ).values()
        return run

    free = run_with(1e-3)
    planned = free.clearance.low
    executed = free.executed_clearance.least.high
    assert free.kept is True and executed < planned - 1e-4
    near = run_with(float(planned + executed) / 2)
    assert near.kept is False and near.verdict.requirement == "limits"
    note = near.to_data()["kept"].note
    assert "post" in note and "20 mm" in note


METHODS = ("inverse", "inverse_dynamics", "pole_placement", "none", None)


@pytest.mark.parametrize("seed", range(8))
def test_the_worse_of_simulation_and_experiment_determines_the_verdict(seed):
    """Random jobs; both executions are simulated here again, from the set-points."""
    random = np.random.default_rng(seed)
    method = METHODS[seed % len(METHODS)]
    points = np.array([0.33, 0.2]) + random.uniform(-0.06, 0.06, (4, 2))
    options = {} if method is None else {"compensation": {"method": method}}
    runs = runs_of(
        path={"points": points.tolist()},
        servo={"kp": random.uniform(15, 40), "kv": random.uniform(100, 250)},
        corners={"tolerance": random.uniform(3e-4, 3e-3)},
        experiment={"payload": {"mass": random.uniform(0, 0.05)}} if random.random() < 0.5 else {},
        runs={"one": {"timing": {"reserve": 0.05}, **options}},
    )
    run = runs["one"]
    assert run.run.compensation.method == (method or "inverse_dynamics")
    experiment = run.experiment.plant
    plants = {"servo": ac.ServoPlant(run.arm, run.servo), "rigid bodies": experiment}
    evaluations = {
        name: ac.evaluate(
            ac.simulate(run.set_points, x), run.path.path, objective=run.objective.path
        )
        for name, x in plants.items()
    }
    errors = {name: x.contour_error.max for name, x in evaluations.items()}
    # The servo model lacks the dynamics that `inverse_dynamics` compensates.
    judges = {"rigid bodies"} if run.run.for_bodies else set(errors)
    worst = max(errors[x] for x in judges)
    data = run.to_data()
    assert run.kept is data["kept"].value is bool(worst <= allowed(run))
    assert set(data["judged_by"].value) == judges
    off = data["off_drawing"]
    assert off.value == pytest.approx(max(evaluations[x].off_drawing for x in judges), rel=1e-3)
    assert off.value <= (run.rounding_error + worst) * (1 + 1e-3)
    assert all(f"{name} {render.number(x, 'm')[:4]}" in off.note for name, x in errors.items())
    assert run.judged.contour_error.max == pytest.approx(worst, rel=1e-3)


def test_a_suggested_change_makes_a_run_kept_on_rigid_bodies():
    changes = {"corners": {"tolerance": 3e-4}, "experiment": {}}
    runs = {"one": {"compensation": {"method": "inverse"}}}
    result = with_advice(ac.run(parse_job(yaml.safe_dump({**JOB, **changes, "runs": runs}))))
    run = result.runs["one"]
    assert run.kept is False and run.evaluation.contour_error.max < allowed(run)
    (change,) = (x for x in run.advice.improvements if "inverse_dynamics" in x.label)
    assert change.edits == (("compensation.method", "inverse_dynamics"),) and change.kept
    (repaired,) = runs_of(**changes, runs={"one": {}}).values()
    assert repaired.kept
    assert repaired.to_data()["off_drawing"].value == pytest.approx(change.off_drawing)
