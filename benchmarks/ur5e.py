"""The UR5e of the benchmarks, its square, and its description for other libraries."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import armcontour as ac
from armcontour.core.checks import FloatArray

# First corner of the square [m].
CORNER = (0.45, 0.08, 0.2)
# Side of the square [m].
SIDE = 0.1
# Orientation of a tool that looks down, as a rotation matrix.
DOWN = np.diag([1.0, -1.0, -1.0])
CORNER_ERROR = 2.5e-4  # m
# Names of the first and the last link in the URDF.
BASE = "base"
TOOL = "tool"


def load() -> ac.SerialArm:
    """Load the UR5e."""
    arm = ac.load_arm("ur5e")
    assert isinstance(arm, ac.SerialArm)
    return arm


def corners() -> FloatArray:
    """Return the square's corners [m], with the first one again at the end, (5, 3)."""
    around = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]])
    return np.asarray(CORNER + SIDE * around)


def square(rotations: npt.ArrayLike = DOWN) -> ac.Path:
    """Make the square with the tool held in one way, or in a way at every corner."""
    return ac.Path.polyline(corners()).oriented(rotations)


def urdf(arm: ac.SerialArm, velocity: float) -> str:
    """Write the arm's kinematics with equal joint velocity limits and as few frames as possible."""
    chain = arm.chain
    ranges = np.column_stack(arm.limits.joint_range(arm.dof)).tolist()
    lines = [f'<robot name="{arm.name}">', f'<link name="{BASE}"/>', '<link name="link0"/>']
    lines += [_joint("base_joint", "fixed", BASE, "link0", chain.base)]
    for k, name in enumerate(chain.joints):
        frame = ac.Frame(position=chain.positions[k], rotation=chain.rotations[k])
        lower, upper = ranges[k]
        more = (
            f'<axis xyz="{_numbers(chain.axes[k])}"/><limit lower="{lower!r}" upper="{upper!r}" '
            f'effort="1000" velocity="{velocity!r}"/>'
        )
        lines += [f'<link name="link{k + 1}"/>']
        lines += [_joint(name, "revolute", f"link{k}", f"link{k + 1}", frame, more)]
    lines += [f'<link name="{TOOL}"/>']
    lines += [_joint("tool_joint", "fixed", f"link{arm.dof}", TOOL, chain.tip @ chain.tool)]
    return "\n".join([*lines, "</robot>"])


def _joint(name: str, kind: str, parent: str, child: str, frame: ac.Frame, more: str = "") -> str:
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(frame.rotation).as_euler("xyz")
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_numbers(frame.position)}" rpy="{_numbers(angles)}"/>{more}</joint>'
    )


def _numbers(values: npt.ArrayLike) -> str:
    return " ".join(repr(x) for x in np.asarray(values).tolist())
