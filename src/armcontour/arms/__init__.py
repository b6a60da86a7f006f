"""Arms: kinematics, limits, and the library of built-in ones. Knows no path and no time."""

from armcontour.arms.arm import Arm
from armcontour.arms.chain import Chain, Payload
from armcontour.arms.dynamics import Dynamics
from armcontour.arms.limits import Limits
from armcontour.arms.loading import arm_names, load_arm
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
    "arm_names",
    "load_arm",
]
