"""What was capped, and joints that are asked for too much: said once, with the values."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

import armcontour as ac
from armcontour.jobs import Experiment, Rounding, Run, teach
from armcontour.program import Contour, Program

LINES = [(0.3, 0.1), (0.36, 0.1), (0.36, 0.14)]


def job(path, **values):
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    asked = {
        "name": "one",
        "timing": "optimal",
        "compensation": "inverse",
        "limits": arm.limits.replace(speed=0.1, centripetal_acceleration=0.09),
        "rounding": Rounding(tolerance=0.25e-3),
        "period": 4e-3,
        "reserve": 0.1,
        **values,
    }
    return ac.Job(
        name="j",
        title="j",
        arm=arm,
        path=path,
        servo=servo,
        plant_servo=servo,
        runs=(Run(**asked),),
    )


def drawn(speed, tolerance, lift=0.0):
    """Two lines with a speed and a tolerance of their own."""
    points = np.array(LINES) + [0.0, lift]
    return ac.Path.polyline(points, demand=ac.Demand(speed=speed, tolerance=tolerance))


def warnings_of(asked):
    return teach(asked)["one"].warnings


def test_a_speed_and_a_tolerance_above_the_runs_are_said_once():
    path = Program(
        moves=(
            Contour(path=drawn(0.15, 0.5e-3), name="MARK 1"),
            Contour(path=drawn(0.05, 0.1e-3, 0.05), name="CUT 1"),
            Contour(path=drawn(0.12, 0.5e-3, 0.1), name="MARK 2"),
        )
    )
    speed, tolerance = warnings_of(job(path))
    assert speed == (
        "Run one: the speed of up to 150 mm/s of contour MARK 1, contour MARK 2 is capped at "
        "100 mm/s by limits.speed: raise limits.speed to have it."
    )
    assert tolerance == (
        "Run one: the corner tolerance of up to 0.5 mm of contour MARK 1, contour MARK 2 is capped "
        "at 0.25 mm by corners.tolerance: raise corners.tolerance to have it."
    )


def test_segments_of_a_single_path_are_named():
    (speed,) = warnings_of(job(drawn(0.15, 0.1e-3)))
    assert "of segment 1, segment 2 is capped" in speed


@pytest.mark.parametrize("speed", [0.1, 0.02])
def test_what_is_not_capped_is_not_said(speed):
    assert warnings_of(job(drawn(speed, 0.25e-3))) == ()


def test_a_demand_far_above_the_limit_is_said_and_by_whom():
    asked = job(drawn(0.1, 0.25e-3))
    assert ac.run(asked).runs["one"].warnings == ()
    lost = dataclasses.replace(asked, servo=ac.ServoModel(kp=15.0, kv=40.0))
    found = ac.run(lost).runs["one"]
    ratio = found.evaluation.demand_ratio
    assert ratio.max() > 1.5
    (warning,) = found.warnings
    joint = int(ratio.argmax())
    assert warning.startswith(f"Run one: joint {joint + 1} is asked for ")
    assert f"{ratio[joint]:.3g} times its acceleration limit at " in warning
    assert f"{found.evaluation.contour_error.max * 1e3:.3g} mm off" in warning
    assert "a larger reserve" in warning


def test_a_run_takes_its_duration():
    asked = job(drawn(0.1, 0.25e-3), duration=4.0)
    assert teach(asked)["one"].trajectory.duration == pytest.approx(4.0, rel=1e-12)


def test_a_smoothed_run_says_which_limit_it_exceeds_and_a_reserve_that_mends_it():
    limits = ac.Limits(joint_acceleration=[0.72, 0.72], speed=0.1)
    own = {"limits": limits, "reserve": 0.0}
    asked = job(drawn(0.1, 0.25e-3), smoothing=(0.03,), **own)
    plan, plain = teach(asked)["one"], teach(job(drawn(0.1, 0.25e-3), **own))["one"]
    assert plan.trajectory.duration == pytest.approx(plain.trajectory.duration + 0.03, rel=1e-12)
    assert plain.warnings == ()
    (warning,) = plan.warnings
    t = np.linspace(0, plan.trajectory.duration, 20001)
    over = np.abs(plan.trajectory(t, 2)) / limits.joint_acceleration
    most = over.max()
    assert most > 1.01
    assert f"smoothing takes joint {over.max(axis=0).argmax() + 1} to " in warning
    said = float(warning.split(" to ")[1].split(" times its joint_acceleration")[0])
    assert said == pytest.approx(most, rel=5e-3)
    share = int(warning.split("reserve: ")[1].split(" %")[0]) / 100
    mended = job(drawn(0.1, 0.25e-3), smoothing=(0.03,), limits=limits, reserve=share)
    assert warnings_of(mended) == ()


def test_smoothing_that_keeps_the_limits_is_not_warned_of():
    line = ac.Path.polyline(LINES[:2])
    assert warnings_of(job(line, smoothing=(0.02, 0.01))) == ()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"timing": "mac"}, ("Run one", "method mac plans joint by joint", "method optimal")),
        ({"duration": 4.0}, ("Run one", "leave out smoothing, or the given duration")),
        ({"smoothing": (0.02, 0.02, 0.02)}, ("one or two windows, not 3",)),
    ],
)
def test_smoothing_that_cannot_be(values, words, refuses):
    limits = ac.load_arm("pmk3s").limits.replace(speed=0.1, centripetal_acceleration=0.09)
    asked = job(
        drawn(0.1, 0.25e-3),
        **{"smoothing": (0.02,), "limits": limits.replace(joint_acceleration=0.72), **values},
    )
    refuses(lambda: teach(asked), ac.InvalidInput, *words)


def test_who_judges_set_points_that_are_for_the_bodies():
    options = {"compensation": "inverse_dynamics", "smoothing": (4e-3,)}
    line = ac.Path.polyline(LINES[:2])
    bare = ac.run(job(line, **options)).runs["one"]
    (warning,) = bare.warnings
    off = bare.evaluation.contour_error.max * 1e3
    assert "the servo model, which has none, does not judge it" in warning
    assert f"(there the tool is up to {off:.3g} mm off)" in warning and "experiment: {}" in warning
    seen = ac.run(job(line, **options, experiment=Experiment())).runs["one"]
    assert seen.experiment is not None
    on_bodies = seen.experiment.evaluation.contour_error.max * 1e3
    assert on_bodies < 0.01 * off
    (warning,) = seen.warnings
    assert f"its experiment judges it (up to {on_bodies:.3g} mm off)" in warning
    assert f"no bodies (up to {off:.3g} mm off)" in warning


def test_no_corner_tolerance_is_capped_where_there_is_no_corner():
    line = ac.Path.polyline([(0.3, 0.2), (0.34, 0.2)], demand=ac.Demand(tolerance=0.5e-3))
    assert warnings_of(job(line)) == ()
    arcs = ac.Path.from_segments(
        [
            ac.Arc(start=(0.3, 0.2), center=(0.3, 0.21), angle=x, demand=ac.Demand(tolerance=y))
            for x, y in ((np.pi, 0.5e-3),)
        ]
    )
    assert warnings_of(job(arcs)) == ()
    # A corner has the smaller one of the two tolerances beside it.
    sides = [
        ac.Line(start=a, end=b, demand=ac.Demand(tolerance=y))
        for a, b, y in (
            ((0.3, 0.2), (0.34, 0.2), 0.5e-3),
            ((0.34, 0.2), (0.34, 0.24), 0.1e-3),
        )
    ]
    assert warnings_of(job(ac.Path.from_segments(sides))) == ()


def approached(dwell):
    """The sentences of a run on two lines with approaches, and its evaluation."""
    axis = (0.0, 0.0, -1.0)
    moves = [ac.Path.polyline([(0.4, y, 0.2), (0.5, y, 0.2)]).pointing(axis) for y in (0.0, 0.05)]
    arm = ac.load_arm("ur5e")
    asked = job(
        Program(moves=tuple(Contour(path=x, name=f"line {i}") for i, x in enumerate(moves))),
        compensation="none",
        limits=arm.limits.replace(speed=0.02),
    )
    process = ac.Process(approach=0.02, retract=0.02, dwell=dwell)
    asked = dataclasses.replace(asked, arm=arm, process=process)
    found = ac.run(asked).runs["one"]
    return [x for x in found.weak_points if "not settled" in x], found.evaluation


def test_what_is_left_of_the_approach_is_said_with_the_dwell_that_mends_it():
    (said,), evaluation = approached(0.0)
    assert said.startswith("where 2 contours begin, most at contour line ")
    later, dwell = (
        float(re.search(x, said).group(1)) for x in (r"and (\S+) mm at most", r"dwell: (\d+) ms")
    )
    assert evaluation.contour_error.max > 1.5e-3 * later
    none, mended = approached(dwell / 1e3)
    assert none == []
    assert mended.contour_error.max <= 1.01e-3 * later


def delayed_loops(taught, limits, delay, step=25e-6):
    """Joint positions of two loops with saturation whose velocity command is delayed.

    Euler's method with its own interpolation; shares no code with the servo model.
    """
    late = round(delay / step)
    t = np.arange(0.0, taught.t[-1] + 0.05, step)
    columns = []
    for joint in range(2):
        u = np.interp(t, taught.t, taught.q[:, joint]).tolist()
        bound = float(limits.joint_acceleration[joint])
        q, dq, asked, found = u[0], 0.0, [0.0] * late, []
        for x in u:
            found.append(q)
            asked.append(25.0 * (x - q))
            acceleration = 150.0 * (asked[-1 - late] - dq)
            dq += step * min(max(acceleration, -bound), bound)
            q += step * dq
        columns.append(found)
    return np.array(columns).T


def test_a_run_at_the_full_limit_states_the_cost_of_a_cycle_of_delay():
    limits = ac.Limits(joint_acceleration=[0.72, 0.72], speed=0.15, centripetal_acceleration=0.09)
    points = [(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)]
    asked = job(
        ac.Path.polyline(points),
        rounding=Rounding(tolerance=5e-3),
        limits=limits,
        compensation="pole_placement",
        reserve=0.0,
    )
    found = ac.run(asked).runs["one"]
    assert any("drive cycle" in x for x in found.warnings)
    # An independent simulation with the delay agrees on the size of the error.
    path = found.path.single_path
    q = delayed_loops(found.taught, limits, 1e-3)
    error = path.project(asked.arm.forward(q)).distance
    rms = float(np.sqrt(np.mean(error**2)))
    assert rms > 10 * found.evaluation.contour_error.rms
    assert found.delayed.contour_error.rms == pytest.approx(rms, rel=0.2)
    with_reserve = dataclasses.replace(
        asked, runs=(dataclasses.replace(asked.runs[0], reserve=0.02),)
    )
    spared = ac.run(with_reserve).runs["one"]
    assert spared.warnings == () and spared.delayed is None
    error = path.project(asked.arm.forward(delayed_loops(spared.taught, limits, 1e-3))).distance
    assert np.sqrt(np.mean(error**2)) < 2 * spared.evaluation.contour_error.rms


@pytest.mark.parametrize(("speed", "count"), [(60.0, 1), (0.06, 0)])
def test_a_speed_that_lacks_its_unit_is_stated(speed: float, count: int) -> None:
    limits = ac.load_arm("pmk3s").limits.replace(speed=speed, centripetal_acceleration=0.09)
    points = teach(job(ac.Path.polyline(LINES), limits=limits))["one"].weak_points
    found = [x for x in points if f"speed: {speed:g} mm/s" in x]
    assert len(found) == count
