"""Arms: kinematics, dynamics and limits. Knows no path, no time and no file."""

from armcontour.arms.arm import Arm, compare_limits, resolve_limits
from armcontour.arms.chain import Chain, Payload
from armcontour.arms.dynamics import Dynamics
from armcontour.arms.limits import Limits
from armcontour.arms.planar import PlanarTwoLink
from armcontour.arms.serial import SerialArm

__all__ = [
    "Arm",
    "Chain",
    "Dynamics",
    "Limits",
    "Payload",
    "PlanarTwoLink",
    "SerialArm",
    "compare_limits",
    "resolve_limits",
]
