"""Shapes of bodies: those of an arm's links and tool, and of obstacles in its cell."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "arm_shapes": "ArmShapes LeftOut LinkShape",
    "scene": "MARGINS Margins Obstacle Scene",
    "shapes": "Box Capsule Cylinder HalfSpace Mesh Shape Sphere",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
