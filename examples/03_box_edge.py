"""A bead along the edges of a box with a UR5e: corners rounded in position and orientation."""

import numpy as np

import armcontour as ac

arm = ac.load_arm("ur5e", tool=ac.Frame(position=(0.0, 0.0, 0.12)))
# Along a top edge of the box, round its corner, and down an upright edge [m].
edges = ac.Path.polyline(
    [(0.35, -0.15, 0.25), (0.35, 0.10, 0.25), (0.55, 0.10, 0.25), (0.55, 0.10, 0.10)]
)
# The nozzle points into each edge, between the two faces that meet there; turning about it is free.
into = np.array([(0.5, 0.0, -1.0), (0.3, -0.3, -1.0), (0.0, -0.5, -1.0), (-0.4, -0.5, -1.0)])
objective = edges.pointing(into)
rounded = ac.round_corners(objective, tolerance=2e-3, angular_tolerance=np.radians(3))
# A fifth of the joints' acceleration is left to the servo.
limits = arm.limits.replace(speed=0.2, joint_acceleration=0.8 * arm.limits.joint_acceleration)

# Elbow up: left to itself, plan takes the fastest configuration, and looks for no collisions.
planned = ac.plan(rounded, arm, limits, ac.Optimal(start=(0.0, -1.1, -2.4, -0.8, 1.6, 1.5)))
explanation = ac.explain(planned, arm, limits)
print(f"{rounded.length * 1e3:.0f} mm in {planned.duration:.3f} s")
for place in explanation.shortfalls:
    print(f"  {place.kind}: {place.sentence}")
servo = ac.ServoModel(kp=25.0, kv=150.0)
for options in (ac.NoCompensation(), ac.PolePlacement(), ac.InverseDynamics()):
    set_points = ac.compensate(planned, servo, options, cycle=4e-3, arm=arm)
    for plant in (ac.ServoPlant(arm, servo), ac.RigidBodyPlant(arm, servo)):
        error = ac.evaluate(
            ac.simulate(set_points, plant), rounded, objective=objective
        ).contour_error
        print(
            f"{set_points.method:16s} {type(plant).__name__:14s} contour error "
            f"{error.rms * 1e3:.4f} mm RMS, {error.max * 1e3:.4f} mm at most"
        )
