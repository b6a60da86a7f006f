"""Limits of jerk: the paper's job is planned with continuous accelerations."""

import warnings

import numpy as np

import armcontour as ac

CYCLE = 4e-3


def show(name, path, limits):
    """Plan a path, and print the jerk of its motion and the acceleration of its set-points."""
    planned = ac.plan(path, arm, limits)
    inside = np.linspace(0.0, planned.duration, 20_001)
    jerk = np.abs(planned(inside, 3)).max()
    samples = planned(np.arange(0.0, planned.duration, CYCLE))
    thirds = np.abs(np.diff(samples, 3, axis=0)).max() / CYCLE**3
    set_points = ac.compensate(planned, servo, without_limit, cycle=CYCLE)
    seconds = np.abs(np.diff(set_points.q, 2, axis=0)).max() / CYCLE**2
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    error = ac.evaluate(executed, path).contour_error
    print(f"{name}: {planned.duration:.3f} s, contour error {error.rms * 1e3:.4f} mm RMS")
    print(f"  jerk {jerk:.2f} rad/s³ between breaks, {thirds:.2f} from samples every 4 ms")
    print(f"  set-points need {seconds:.2f} rad/s², the limit is {limits.joint_acceleration[0]}")


arm = ac.load_arm("pmk3s")
servo = ac.ServoModel(kp=25.0, kv=150.0)
# By default, set-points have at most 3 times the planned acceleration.
without_limit = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
objective = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
arcs = ac.round_corners(objective, tolerance=5e-3)
smooth = ac.round_corners(objective, tolerance=5e-3, continuity="curvature")

show("arcs, no limit of jerk", arcs, limits)
show("continuous curvature, no limit of jerk", smooth, limits)
for times in (50, 10):
    show(f"jerk {times} times the acceleration", smooth, limits.replace(joint_jerk=times * 0.72))
warnings.simplefilter("ignore")  # plan warns of the stops
show("the same limit on arcs, which require stops", arcs, limits.replace(joint_jerk=7.2))
