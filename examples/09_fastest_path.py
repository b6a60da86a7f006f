"""The fastest path within a tolerance: the example compares shaped paths with rounded paths."""

import armcontour as ac


def compare(name, objective, arm, limits, tolerance, **options):
    """Print the durations with arcs and with the shaped path; return the shaped motion."""
    arcs = ac.plan(ac.round_corners(objective, tolerance=tolerance), arm, limits)
    shaped = ac.plan(objective, arm, limits, ac.Shaped(tolerance=tolerance, **options))
    outcome = shaped.path.outcome
    print(
        f"{name}: {shaped.duration:.2f} s, arcs take {arcs.duration:.2f} s; "
        f"{outcome.gain:.1%} less than {outcome.start}"
    )
    return shaped


arm = ac.load_arm("pmk3s")
objective = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
compare("1 mm", objective, arm, limits, 1e-3)
planned = compare("5 mm", objective, arm, limits, 5e-3)

servo = ac.ServoModel(kp=25.0, kv=150.0)
set_points = ac.compensate(planned, servo, ac.InverseDynamics(), cycle=4e-3, arm=arm)
executed = ac.simulate(set_points, ac.RigidBodyPlant(arm, servo))
for name, path in (("shaped", planned.path), ("objective", objective)):
    error = ac.evaluate(executed, path).contour_error
    print(f"  executed within {error.max * 1e3:.2f} mm of the {name} path")

ur5e = ac.load_arm("ur5e")
seam = ac.Path.polyline([(0.35, -0.10, 0.15), (0.50, -0.10, 0.15), (0.50, 0.05, 0.20)])
limits = ur5e.limits.replace(speed=0.25, joint_acceleration=8.0)
torch = seam.pointing((0.0, 0.0, -1.0))
compare("seam on a UR5e, 1 mm, ten iterations", torch, ur5e, limits, 1e-3, iterations=10)
