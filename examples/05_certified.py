"""A certified plan: `certify` finds the fastest plan within 0.01 mm for a dead time of 40 ms."""

import armcontour as ac

arm = ac.load_arm("pmk3s")
delayed_servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.04)
job = ac.Job(
    name="slot",
    title="A slot, certified",
    arm=arm,
    path=ac.Path.polyline([(0.30, 0.15), (0.40, 0.15), (0.40, 0.25), (0.30, 0.25)]),
    servo=delayed_servo,
    plant_servo=delayed_servo,
    runs=(
        ac.Run(
            name="slot",
            limits=arm.limits.replace(speed=0.12, centripetal_acceleration=0.09),
            rounding=ac.Rounding(tolerance=2e-3),
            cycle=4e-3,
        ),
    ),
)
certificate = ac.certify(job, goal=ac.CertificateGoal(servo_error=1e-5))
error = certificate.result.evaluation.contour_error
print(
    f"certified in {certificate.duration:.3f} s, "
    f"{certificate.cost * 1e3:.0f} ms more than the optimum"
)
print(f"contour error {error.max * 1e3:.4f} mm at most; holds for: {certificate.model}")
print(f"set-points lead by {-certificate.set_points.start_time * 1e3:.0f} ms")
