"""Your own job: the example plans a slot, and compares it with and without compensation."""

import numpy as np

import armcontour as ac

arm = ac.load_arm("pmk3s")
slot = ac.Path(
    segments=[
        ac.Line(start=(0.28, 0.20), end=(0.40, 0.20)),
        ac.Arc(start=(0.40, 0.20), center=(0.40, 0.23), angle=np.pi),
        ac.Line(start=(0.40, 0.26), end=(0.28, 0.26)),
    ]
)
limits = arm.limits.replace(speed=0.10, centripetal_acceleration=0.05)
planned = ac.plan(slot, arm, limits, ac.Paper())
servo = ac.ServoModel(kp=[25.0, 20.0], kv=150.0)
errors = {}
for options in (ac.NoCompensation(), ac.PolePlacement()):
    set_points = ac.compensate(planned, servo, options, cycle=1e-3)
    executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    error = errors[set_points.method] = ac.evaluate(executed, slot, limits=limits).contour_error
    print(
        f"{set_points.method:15s} contour error {error.rms * 1e3:.4f} mm RMS, "
        f"{error.max * 1e3:.4f} mm at most"
    )
