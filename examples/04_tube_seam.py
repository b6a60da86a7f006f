"""A weld seam around a tube: a UR5e reaches the seam if rotation about the torch axis is free."""

import math

import armcontour as ac

torch = ac.Frame.rpy((0.085, 0.0, 0.165), (0.0, math.pi / 4, 0.0))
arm = ac.load_arm("ur5e", tool=torch)
center = (0.45, 0.0, 0.35)
radius = 0.08
seam = ac.Path(segments=[ac.Arc.circle((0.45, 0.0, 0.35 + radius), center, normal=(0.0, 1.0, 0.0))])
limits = arm.limits.replace(speed=0.05)

# With the full orientation prescribed, no configuration (IK branch) reaches the whole seam.
try:
    ac.plan(seam.following_tangent((0.0, 0.0, 1.0)), arm, limits)
except ac.Unreachable as error:
    print(f"fixed: {error}")

# With only the axis prescribed, `plan` chooses the rotation about it.
free = seam.following_tangent((0.0, 0.0, 1.0), axis_only=True)
# The plan leaves 5 % of the joint acceleration to the servo.
planned = ac.plan(free, arm, limits, ac.Optimal(reserve=0.05))
servo = ac.ServoModel(kp=25.0, kv=150.0)
set_points = ac.compensate(planned, servo, ac.Inverse(), cycle=2e-3)
result = ac.evaluate(ac.simulate(set_points, ac.ServoPlant(arm, servo)), free, limits=limits)
print(f"free:  all {free.length * 1e3:.0f} mm in {planned.duration:.2f} s")
print(
    f"contour error {result.contour_error.max * 1e3:.4f} mm at most, "
    f"torch axis off by {math.degrees(result.orientation_error.max):.4f}° at most"
)
