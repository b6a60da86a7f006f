"""Shapes of bodies: those of an arm's links and tool, and of obstacles in its cell."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.scene.arm_shapes import ArmShapes, LeftOut, LinkShape
    from armcontour.scene.scene import MARGINS, Margins, Obstacle, Scene
    from armcontour.scene.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, Shape, Sphere
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "arm_shapes": "ArmShapes LeftOut LinkShape",
            "scene": "MARGINS Margins Obstacle Scene",
            "shapes": "Box Capsule Cylinder HalfSpace Mesh Shape Sphere",
        },
    )
