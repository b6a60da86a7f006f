"""The nominal robot: drives with position and velocity loops that move an arm's bodies."""

# Compensation, learning, identification and certification use it; plants, which verify their
# results, do not.

from armcontour.core.lazy import lazy_names

_HOME = {
    "drives": "Drives",
    "response": "Response NominalMotion regular_times respond_along simulate",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
