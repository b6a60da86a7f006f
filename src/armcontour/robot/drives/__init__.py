"""The nominal robot: drives with position and velocity loops that move an arm's bodies.

Compensation, learning, identification and certification use it. Plants, which judge their results,
do not.
"""

from armcontour.core.lazy import lazy_names

_HOME = {
    "drives": "Drives",
    "response": "Response regular_times respond_along",
    "simulation": "Simulation simulate",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
