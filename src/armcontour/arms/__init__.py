"""Arms: kinematics, dynamics and limits. Knows no path, no time and no file."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.arms.arm import Arm, compare_limits, resolve_limits
    from armcontour.arms.chain import Chain, Payload
    from armcontour.arms.dynamics import Dynamics
    from armcontour.arms.limits import Limits
    from armcontour.arms.planar import PlanarTwoLink
    from armcontour.arms.serial import SerialArm
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "arm": "Arm compare_limits resolve_limits",
            "chain": "Chain Payload",
            "dynamics": "Dynamics",
            "limits": "Limits",
            "planar": "PlanarTwoLink",
            "serial": "SerialArm",
        },
    )
