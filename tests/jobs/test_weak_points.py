"""What was capped, and joints that are asked for too much: said once, with the values."""

import dataclasses
import re

import numpy as np
import pytest
from tests.geometry.tables import arc, line, path_of, refused
from tests.jobs.making import ARM, a_job, a_run

import armcontour as ac
from armcontour.jobs import Experiment, Rounding, teach
from armcontour.program import Contour, Program

LINES = [(0.3, 0.1), (0.36, 0.1), (0.36, 0.14)]
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)


def job(path, *, arm=ARM, process=None, **values):
    asked = {"limits": LIMITS, "rounding": Rounding(tolerance=0.25e-3), "reserve": 0.1, **values}
    return a_job(path, a_run(**asked), arm=arm, process=process)


def drawn(speed=0.1, tolerance=0.25e-3, lift=0.0):
    """Two lines with a speed and a tolerance of their own."""
    points = np.array(LINES) + [0.0, lift]
    return ac.Path.polyline(points, demand=ac.Demand(speed=speed, tolerance=tolerance))


def warnings_of(asked):
    return teach(asked)["one"].warnings


def only(asked):
    return ac.run(asked).runs["one"]


def test_a_speed_and_a_tolerance_above_the_runs_are_said_once():
    values = (0.15, 0.5e-3), (0.05, 0.1e-3, 0.05), (0.12, 0.5e-3, 0.1)
    names = "MARK 1", "CUT 1", "MARK 2"
    moves = (Contour(path=drawn(*x), name=y) for x, y in zip(values, names, strict=True))
    speed, tolerance = warnings_of(job(Program(moves=tuple(moves))))
    capped = "of contour MARK 1, contour MARK 2 is capped at "
    assert f"speed of up to 150 mm/s {capped}100 mm/s by limits.speed: " in speed
    assert f"tolerance of up to 0.5 mm {capped}0.25 mm by corners.tolerance: " in tolerance
    (speed,) = warnings_of(job(drawn(0.15, 0.1e-3)))
    assert "of segment 1, segment 2 is capped" in speed


def test_what_is_not_capped_is_not_said():
    assert warnings_of(job(drawn(0.1))) == warnings_of(job(drawn(0.02))) == ()
    # No corner tolerance is capped where there is no corner.
    single = ac.Path.polyline([(0.3, 0.2), (0.34, 0.2)], demand=ac.Demand(tolerance=0.5e-3))
    assert warnings_of(job(single)) == ()
    half = arc((0.3, 0.2), (0.3, 0.21), np.pi, demand=ac.Demand(tolerance=0.5e-3))
    assert warnings_of(job(path_of(half))) == ()
    # A corner has the smaller one of the two tolerances beside it.
    first = line((0.3, 0.2), (0.34, 0.2), tolerance=0.5e-3)
    assert warnings_of(job(path_of(first, line((0.34, 0.2), (0.34, 0.24), tolerance=1e-4)))) == ()


def test_a_demand_far_above_the_limit_is_said_and_by_whom():
    asked = job(drawn())
    assert only(asked).warnings == ()
    found = only(dataclasses.replace(asked, servo=ac.ServoModel(kp=15.0, kv=40.0)))
    ratio = found.evaluation.demand_ratio
    assert ratio.max() > 1.5
    (warning,) = found.warnings
    joint = int(ratio.argmax())
    assert f"joint {joint + 1} is asked for " in warning and "a larger reserve" in warning
    assert f"{ratio[joint]:.3g} times its acceleration limit at " in warning
    assert f"{found.evaluation.contour_error.max * 1e3:.3g} mm off" in warning


def test_a_smoothed_run_says_which_limit_it_exceeds_and_a_reserve_that_mends_it():
    limits = ac.Limits(joint_acceleration=[0.72, 0.72], speed=0.1)

    def smoothed(windows, reserve=0.0):
        return teach(job(drawn(), smoothing=windows, limits=limits, reserve=reserve))["one"]

    plan, plain = smoothed((0.03,)), smoothed(())
    assert plan.trajectory.duration == pytest.approx(plain.trajectory.duration + 0.03, rel=1e-12)
    assert plain.warnings == ()
    (warning,) = plan.warnings
    t = np.linspace(0, plan.trajectory.duration, 20001)
    over = np.abs(plan.trajectory(t, 2)) / limits.joint_acceleration
    assert over.max() > 1.01
    assert f"smoothing takes joint {over.max(axis=0).argmax() + 1} to " in warning
    said = float(warning.split(" to ")[1].split(" times its joint_acceleration")[0])
    assert said == pytest.approx(over.max(), rel=5e-3)
    share = int(warning.split("reserve: ")[1].split(" %")[0]) / 100
    assert smoothed((0.03,), reserve=share).warnings == ()
    # Smoothing that keeps the limits is not warned of.
    assert warnings_of(job(ac.Path.polyline(LINES[:2]), smoothing=(0.02, 0.01))) == ()


def test_smoothing_that_cannot_be_is_refused_and_a_duration_is_kept():
    def taught(**values):
        limits = LIMITS.replace(joint_acceleration=0.72)
        return lambda: teach(job(drawn(), limits=limits, **{"smoothing": (0.02,), **values}))

    refused(
        (taught(timing="mac"), "Run one", "method mac"),
        (taught(duration=4.0), "Run one", "leave out smoothing, or the given duration"),
        (taught(smoothing=(0.02, 0.02, 0.02)), "one or two windows, not 3"),
    )
    plan = teach(job(drawn(), duration=4.0))["one"]
    assert plan.trajectory.duration == pytest.approx(4.0, rel=1e-12)


def test_who_judges_set_points_that_are_for_the_bodies():
    options = {"compensation": "inverse_dynamics", "smoothing": (4e-3,)}
    straight = ac.Path.polyline(LINES[:2])
    bare = only(job(straight, **options))
    (warning,) = bare.warnings
    off = bare.evaluation.contour_error.max * 1e3
    assert f"(there the tool is up to {off:.3g} mm off)" in warning and "experiment: {}" in warning
    seen = only(job(straight, **options, experiment=Experiment()))
    on_bodies = seen.experiment.evaluation.contour_error.max * 1e3
    assert on_bodies < 0.01 * off
    assert seen.warnings == () and seen.judged is seen.experiment.evaluation


def test_a_compensation_that_is_worse_than_none_on_bodies_is_warned_of():
    experiment = Experiment(coulomb=[0.02, 0.0])
    seen = only(job(ac.Path.polyline(LINES), compensation="inverse", experiment=experiment))
    judged, plain = seen.experiment.evaluation, seen.experiment.uncompensated
    assert plain.contour_error.rms > judged.contour_error.rms > 0
    for evaluation, uncompensated in ((judged, judged), (judged, None), (plain, judged)):
        other = dataclasses.replace(
            seen.experiment, evaluation=evaluation, uncompensated=uncompensated
        )
        said = [x for x in dataclasses.replace(seen, experiment=other).warnings if "bodies" in x]
        assert len(said) == (evaluation is plain)
    for value in (plain.contour_error.rms, judged.contour_error.rms):
        assert f"{value * 1e3:.4g} " in said[0]
    assert "method: inverse_dynamics" in said[0] and "0.02, 0 N m" in said[0]
    assert (
        only(job(ac.Path.polyline(LINES), compensation="none", experiment=experiment)).warnings
        == ()
    )


def approached(dwell):
    """The sentences of a run on two lines with approaches, and its evaluation."""
    ends = [[(0.4, y, 0.2), (0.5, y, 0.2)] for y in (0.0, 0.05)]
    moves = [ac.Path.polyline(x).pointing((0.0, 0.0, -1.0)) for x in ends]
    program = Program(moves=tuple(Contour(path=x, name=f"line {i}") for i, x in enumerate(moves)))
    arm, process = ac.load_arm("ur5e"), ac.Process(approach=0.02, retract=0.02, dwell=dwell)
    values = {"compensation": "none", "limits": arm.limits.replace(speed=0.02)}
    found = only(job(program, arm=arm, process=process, **values))
    return [x for x in found.weak_points if "not settled" in x], found.evaluation


def test_what_is_left_of_the_approach_is_said_with_the_dwell_that_mends_it():
    (said,), evaluation = approached(0.0)
    assert said.startswith("where 2 contours begin, most at contour line ")
    patterns = r"and (\S+) mm at most", r"dwell: (\d+) ms"
    later, dwell = (float(re.search(x, said).group(1)) for x in patterns)
    assert evaluation.contour_error.max > 1.5e-3 * later
    none, mended = approached(dwell / 1e3)
    assert none == []
    assert mended.contour_error.max <= 1.01e-3 * later


def delayed_loops(taught, limits, delay, step=50e-6):
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
    rounding = Rounding(tolerance=5e-3)
    values = {"rounding": rounding, "limits": limits, "compensation": "pole_placement"}
    # An independent simulation with the delay agrees on the size of the error.
    found, spared = (only(job(ac.Path.polyline(points), **values, reserve=x)) for x in (0.0, 0.02))
    late = [delayed_loops(x.taught, limits, 1e-3) for x in (found, spared)]
    errors = [found.path.single_path.project(ARM.forward(q)).distance for q in late]
    rms, with_reserve = (float(np.sqrt(np.mean(x**2))) for x in errors)
    assert any("drive cycle" in x for x in found.warnings)
    assert rms > 10 * found.evaluation.contour_error.rms
    assert found.delayed.contour_error.rms == pytest.approx(rms, rel=0.2)
    assert spared.warnings == () and spared.delayed is None
    assert with_reserve < 2 * spared.evaluation.contour_error.rms


def test_a_speed_that_lacks_its_unit_is_stated():
    for speed, count in ((60.0, 1), (0.06, 0)):
        limits = LIMITS.replace(speed=speed)
        points = teach(job(ac.Path.polyline(LINES), limits=limits))["one"].weak_points
        assert len([x for x in points if f"speed: {speed:g} mm/s" in x]) == count


def test_a_corner_tolerance_larger_than_the_path_is_questioned():
    def doubts(tolerance):
        found = warnings_of(job(ac.Path.polyline(LINES), rounding=Rounding(tolerance=tolerance)))
        return [x for x in found if "larger than the path" in x]

    assert doubts(0.05) == []
    (doubt,) = doubts(0.5)
    assert "0.5 m" in doubt and "tolerance: 0.5 mm" in doubt
