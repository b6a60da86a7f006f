"""Joint paths along paths of continuous curvature: no derivative up to the second jumps."""

import numpy as np
import pytest

import armcontour as ac

DOWN = np.diag([1.0, -1.0, -1.0])
PAPER_JOB = [(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)]
POINTS = [(0.40, 0.0, 0.2), (0.5, 0.0, 0.2), (0.5, 0.1, 0.2), (0.4, 0.1, 0.25)]


def jumps(joint_path):
    """Largest jumps of q and its first two derivatives at breaks, over their largest sizes."""
    i, at = np.arange(len(joint_path.breaks) - 2), joint_path.breaks[1:-1]
    found = []
    for order in range(3):
        after = joint_path.on_interval(i + 1, at, order)
        jump = np.abs(joint_path.on_interval(i, at, order) - after)
        found.append(jump.max() / np.abs(after).max())
    return found


def paths():
    path = ac.Path.polyline(POINTS)
    turned = [ac.frames.from_rpy((0.1 * i, 0, 0.2 * i)) @ DOWN for i in range(4)]
    flat = ac.Path.polyline([(*x[:2], 0.2) for x in POINTS])
    return {
        "fixed": path.oriented(DOWN),
        "turning": path.oriented(turned),
        "axis": path.pointing([(0, 0, -1), (0, 0.1, -1), (0.1, 0.1, -1), (0, 0.3, -1)]),
        "following": flat.following_tangent((0, 0, 1)),
    }


def test_on_the_planar_arm():
    path = ac.Path.polyline(PAPER_JOB)
    arm = ac.load_arm("pmk3s")
    smooth = ac.round_corners(path, tolerance=5e-3, continuity="curvature")
    assert max(jumps(ac.trace(smooth, arm))) < 1e-12
    arcs = ac.round_corners(path, tolerance=5e-3)
    assert jumps(ac.trace(arcs, arm))[2] > 0.1


@pytest.mark.parametrize(
    ("arm", "kind"),
    [*(("ur5e", kind) for kind in paths()), ("panda", "axis"), ("panda", "following")],
)
def test_on_arms_in_space(arm, kind):
    path = ac.round_corners(
        paths()[kind], tolerance=5e-3, continuity="curvature", angular_tolerance=0.1
    )
    assert max(jumps(ac.trace(path, ac.load_arm(arm)))) < 1e-9
