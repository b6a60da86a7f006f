"""Compensation of the delay of servos: set-points with which the joints follow a trajectory."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "compensator": "METHODS CompensationOptions Inverse InverseDynamics NoCompensation "
    "PolePlacement compensate"
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
