"""A bead along the edges of a box: `round_corners` rounds position and orientation on a UR5e."""

import numpy as np

import armcontour as ac

arm = ac.load_arm("ur5e", tool=ac.Frame(position=(0.0, 0.0, 0.12)))
# Two top edges of the box, then down a vertical edge [m].
edges = ac.Path.polyline(
    [(0.35, -0.15, 0.25), (0.35, 0.10, 0.25), (0.55, 0.10, 0.25), (0.55, 0.10, 0.10)]
)
# The nozzle points between the two faces of each edge; the rotation about its axis is free.
into = np.array([(0.5, 0.0, -1.0), (0.3, -0.3, -1.0), (0.0, -0.5, -1.0), (-0.4, -0.5, -1.0)])
objective = edges.pointing(into)
rounded = ac.round_corners(objective, tolerance=2e-3, angular_tolerance=np.radians(3))
# The plan leaves a fifth of the joint acceleration to the servo.
limits = arm.limits.replace(speed=0.2, joint_acceleration=0.8 * arm.limits.joint_acceleration)

# The seed selects elbow up. Without it, plan uses the fastest configuration, also if it collides.
planned = ac.plan(rounded, arm, limits, ac.Optimal(seed=(0.0, -1.1, -2.4, -0.8, 1.6, 1.5)))
explanation = ac.explain(planned, arm, limits)
print(f"{rounded.length * 1e3:.0f} mm in {planned.duration:.3f} s")
for place in explanation.shortfalls:
    print(f"  {place.kind}: {place.sentence}")
servo = ac.ServoModel(kp=25.0, kv=150.0)
for options in (ac.NoCompensation(), ac.PolePlacement(), ac.InverseDynamics()):
    set_points = ac.compensate(planned, servo, options, cycle=2e-3, arm=arm)
    for plant in (ac.ServoPlant(arm, servo), ac.RigidBodyPlant(arm, servo)):
        error = ac.evaluate(
            ac.simulate(set_points, plant), rounded, objective=objective
        ).contour_error
        print(
            f"{set_points.method:16s} {type(plant).__name__:14s} contour error "
            f"{error.rms * 1e3:.4f} mm RMS, {error.max * 1e3:.4f} mm at most"
        )
