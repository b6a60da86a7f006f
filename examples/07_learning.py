"""Learning from run to run: `learn` reduces the contour error of a robot with unknown friction."""

import armcontour as ac
from armcontour.robot import Payload

arm = ac.load_arm("ur5e").with_dynamics(armature=0.1)
servo = ac.ServoModel(kp=25.0, kv=150.0)
corner = ac.Path.polyline([(0.45, 0.00, 0.20), (0.50, 0.00, 0.20), (0.50, 0.03, 0.20)])
path = ac.round_corners(
    corner.pointing((0.0, 0.0, -1.0)), tolerance=0.25e-3, continuity="curvature"
)
limits = arm.limits.replace(speed=0.25, joint_acceleration=6.4, joint_jerk=320.0)
planned = ac.plan(path, arm, limits)

# The simulated robot; its load, friction and gains are unknown to `learn`.
loaded = arm.with_dynamics(
    payload=Payload(mass=2.0),
    coulomb=[6.0, 6.0, 4.0, 1.5, 1.5, 1.5],
    viscous=[8.0, 8.0, 5.0, 2.0, 2.0, 2.0],
)
real = servo.replace(kp=[25.0, 24.0, 26.0, 23.0, 25.0, 25.5])

set_points = ac.compensate(planned, servo, ac.InverseDynamics(), cycle=2e-3, arm=arm)
errors = []
for run in range(1, 4):
    robot = ac.RigidBodyPlant(loaded, real, controller=arm, noise=1e-5, seed=run)
    executed = ac.simulate(set_points, robot)
    error = ac.evaluate(executed, path).contour_error
    errors.append(error)
    print(
        f"run {run}: contour error {error.rms * 1e3:.3f} mm RMS, {error.max * 1e3:.3f} mm at most"
    )
    set_points = ac.learn(set_points, executed, arm=arm, servo=servo)
print(f"best run: {set_points.best + 1}, {set_points.remaining * 1e3:.3f} mm RMS in its log")
