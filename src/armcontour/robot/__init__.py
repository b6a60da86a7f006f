"""Robot arms: kinematics, dynamics and limits, without paths, time laws or files."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "armcontour.core.errors": "ArmMismatch",
    "arm": "Arm compare_limits load_named resolve_limits",
    "bodies": "Payload",
    "chain": "Chain",
    "dynamics": "Dynamics",
    "external_axes": "Positioner PositionerAxis Rail",
    "limits": "Limits",
    "planar": "PlanarTwoLink",
    "preferences": "JointPreference",
    "serial": "SerialArm",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
