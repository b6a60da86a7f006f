"""Clearance from a post: `check_clearance` proves the margins, or returns the first violation."""

import armcontour as ac
from armcontour.robot.scene import Box, HalfSpace

arm = ac.load_arm("ur5e", tool=ac.Frame(position=(0.0, 0.0, 0.15)))
seam = ac.Path.polyline([(0.45, -0.25, 0.10), (0.45, 0.25, 0.10)]).pointing((0.0, 0.0, -1.0))
limits = arm.limits.replace(speed=0.2)
planned = ac.plan(seam, arm, limits, ac.Optimal(seed=(0.0, -1.2, -2.0, -1.5, 1.57, 0.0)))


def scene_with_post(x: float) -> ac.Scene:
    """Return a scene with a table under the arm and a post at x [m] next to the seam."""
    table = ac.Obstacle(name="table", shape=HalfSpace(), place=ac.Frame(position=(0.0, 0.0, -0.02)))
    post = ac.Obstacle(
        name="post", shape=Box(size=(0.06, 0.06, 0.6)), place=ac.Frame(position=(x, 0.12, 0.3))
    )
    return ac.Scene(obstacles=(table, post))


for x in (0.35, 0.60):
    clearance = ac.check_clearance(planned, arm, scene_with_post(x))
    print(f"post at x = {x:.2f} m: {'clear' if clearance.satisfied else 'too near'}")
    # `nearest` contains the nearest pair of each kind, also of two arm links.
    for pair in clearance.nearest if clearance.satisfied else clearance.too_near[:1]:
        names = f"{pair.first} and {pair.second}"
        if pair.satisfied:
            print(f"  {names}: {pair.low * 1e3:.1f} mm or more during the whole motion")
        else:
            print(f"  {names}: below {pair.margin * 1e3:.0f} mm from {pair.first_time:.3f} s")
