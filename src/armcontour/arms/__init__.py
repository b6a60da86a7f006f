"""Arms: kinematics, limits, and the library of built-in ones. Knows no path and no time."""

from armcontour.arms.arm import Arm
from armcontour.arms.limits import Limits
from armcontour.arms.loading import arm_names, load_arm
from armcontour.arms.planar import PlanarTwoLink

__all__ = ["Arm", "Limits", "PlanarTwoLink", "arm_names", "load_arm"]
