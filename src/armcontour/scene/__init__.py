"""Shapes of bodies: those of an arm's links and tool, and of obstacles in its cell."""

from armcontour.scene.arm_shapes import ArmShapes, LeftOut, LinkShape
from armcontour.scene.scene import MARGINS, Margins, Obstacle, Scene
from armcontour.scene.shapes import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Mesh,
    Shape,
    Sphere,
)

__all__ = [
    "MARGINS",
    "ArmShapes",
    "Box",
    "Capsule",
    "Cylinder",
    "HalfSpace",
    "LeftOut",
    "LinkShape",
    "Margins",
    "Mesh",
    "Obstacle",
    "Scene",
    "Shape",
    "Sphere",
]
