"""Nominal robot: drives with position and velocity loops that move the bodies of an arm."""

# Compensation, learning, identification and certification use the nominal robot. Plants verify the
# results of these steps, so they do not use the nominal robot.

from armcontour.core.lazy import lazy_names

_HOME = {
    "drives": "Drives",
    "response": "Response NominalMotion regular_times respond_along simulate",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
