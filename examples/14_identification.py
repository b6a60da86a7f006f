"""The servo from a log: `identify` determines the gains and the dead time of a simulated robot."""

import numpy as np

import armcontour as ac

arm = ac.load_arm("pmk3s")
data_sheet = ac.ServoModel(kp=25.0, kv=150.0)
# The simulated robot; its servo is unknown to the compensation.
robot = ac.ServoPlant(arm, ac.ServoModel(kp=[23.0, 20.0], kv=[150.0, 120.0], dead_time=0.012))

# Excite both joints by a multisine of 5 mrad for 12 s, with a step of 0.5 rad for 2 s.
# Record two programs, so that the model of each program is tested on the other one.
t = np.arange(0.0, 12.0, 4e-3)
logs = []
frequencies = np.arange(0.5, 25.0, 1 / 12)  # Hz, in steps of 1 / duration
for program in (1, 2):
    random = np.random.default_rng(program)
    phases = random.uniform(0.0, 2 * np.pi, (2, len(frequencies)))
    u = np.cos(2 * np.pi * t[:, None, None] * frequencies + phases).sum(axis=2)
    u *= 5e-3 / np.abs(u).max()
    u[(t > 8.0) & (t < 10.0)] += 0.5
    u += (0.3, 1.2)
    rest = ac.Trajectory(laws=(ac.dwell_law(u[0], t[-1]),), method="rest")
    shaken = ac.simulate(ac.SetPoints(cycle=4e-3, q=u, trajectory=rest, method="shaking"), robot)
    noise = 1e-5 * random.standard_normal(u.shape)
    q = np.stack([np.interp(t, shaken.t, x) for x in shaken.q.T], axis=1) + noise
    logs.append(ac.Log(t=t, command=u, measured=q, interpolation="linear"))

identification = ac.identify(logs)
for joint in identification.joints:
    print(
        f"{joint.name}: K_p {joint.kp.value:.2f} 1/s, K_v {joint.kv.value:.1f} 1/s, "
        f"dead time {joint.dead_time.value * 1e3:.2f} ms"
    )

corner = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20), (0.40, 0.30)])
path = ac.round_corners(corner, tolerance=2e-3)
limits = arm.limits.replace(speed=0.1, centripetal_acceleration=0.05)
planned = ac.plan(path, arm, limits, ac.Optimal(reserve=0.1))
errors = {}
for name, servo in (("data sheet", data_sheet), ("identified", identification.servo_model())):
    set_points = ac.compensate(planned, servo, ac.Inverse(), cycle=4e-3)
    error = errors[name] = ac.evaluate(ac.simulate(set_points, robot), path).contour_error
    print(f"{name}: contour error {error.rms * 1e3:.4f} mm RMS, {error.max * 1e3:.4f} mm at most")
