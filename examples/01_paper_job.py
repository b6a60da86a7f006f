"""The paper's job: the example calls each function from the objective path to the contour error."""

import armcontour as ac

arm = ac.load_arm("pmk3s")
objective = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
rounded = ac.round_corners(objective, tolerance=5e-3)
limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)

planned = ac.plan(rounded, arm, limits, ac.Paper(knots=600))
servo = ac.ServoModel(kp=25.0, kv=150.0)
set_points = ac.compensate(planned, servo, ac.PolePlacement(), cycle=4e-3)
executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
result = ac.evaluate(executed, rounded, objective=objective, limits=limits)

print(f"motion {result.duration:.3f} s, at rest after {result.settled:.3f} s")
print(
    f"contour error {result.contour_error.rms * 1e3:.4f} mm RMS, "
    f"{result.contour_error.max * 1e3:.4f} mm at most"
)
for stretch in planned.stretches:
    print(f"  {stretch.t[1]:7.4f} s  {stretch.name}: {stretch.kind}")
