"""Compensation of the delay of servos: set-points with which the joints follow a trajectory."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "compensator": "compensate",
    "inverse": "INVERSE Inverse",
    "inverse_dynamics": "InverseDynamics",
    "method": "CompensationOptions",
    "no_compensation": "NoCompensation",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
