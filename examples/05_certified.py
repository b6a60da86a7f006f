"""A certified plan: the fastest whose executed tool stays within 0.01 mm, 40 ms late or not."""

import armcontour as ac

arm = ac.load_arm("pmk3s")
late = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.04)
job = ac.Job(
    name="slot",
    title="A slot, certified",
    arm=arm,
    path=ac.Path.polyline([(0.30, 0.15), (0.40, 0.15), (0.40, 0.25), (0.30, 0.25)]),
    servo=late,
    plant_servo=late,
    runs=(
        ac.Run(
            name="slot",
            limits=arm.limits.replace(speed=0.12, centripetal_acceleration=0.09),
            rounding=ac.Rounding(tolerance=2e-3),
            cycle=4e-3,
        ),
    ),
)
found = ac.certify(job, goal=ac.CertificateGoal(servo=1e-5))
error = found.evaluation.contour_error
print(f"certified in {found.duration:.3f} s, {found.cost * 1e3:.0f} ms more than the optimum")
print(f"contour error {error.max * 1e3:.4f} mm at most; holds for: {found.model}")
print(f"set-points lead by {-found.set_points.start_time * 1e3:.0f} ms")
