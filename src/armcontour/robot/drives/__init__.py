"""Nominal robot: drives with position and velocity loops that move the bodies of an arm."""

# Compensation, learning, identification and certification use the nominal robot. Plants, which
# verify their results, do not use it.

from armcontour.core.lazy import lazy_names

_HOME = {
    "drives": "Drives",
    "response": "Response NominalMotion regular_times respond_along simulate",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
