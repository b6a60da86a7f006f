"""Shapes of built-in arms, and what is added to the shapes of an arm."""

from __future__ import annotations

import json
from functools import partial
from importlib import resources
from pathlib import Path as FilePath

import numpy as np

from armcontour.arms.arm import Arm
from armcontour.io.robots.srdf import read_left_out
from armcontour.scene import ArmShapes, LinkShape, Mesh

# Lengths in files of hulls are whole numbers of this [m].
STEP = 1e-6


def with_hulls(arm: Arm, name: str) -> Arm:
    """A built-in arm with the hulls of its links, if there are any.

    Args:
        arm: The arm.
        name: Its built-in name.
    """
    file = resources.files("armcontour.io.robots") / "library" / "hulls" / f"{name}.json"
    return arm.with_shapes(partial(read_hulls, file.read_bytes())) if file.is_file() else arm


def read_hulls(content: bytes) -> ArmShapes:
    """Read a file of hulls: convex bodies that hold the links of an arm.

    Args:
        content: The content of the file.
    """
    data = json.loads(content)
    return ArmShapes(
        shapes=tuple(
            LinkShape(
                name=x["name"],
                link=x["link"],
                shape=Mesh(points=STEP * np.array(x["points"]), source=f"the hull of {x['name']}"),
            )
            for x in data["hulls"]
        ),
        source=f"{data['source']} {data['license']}",
    )


def with_more_shapes(
    arm: Arm, shapes: tuple[LinkShape, ...] = (), srdf: FilePath | None = None
) -> Arm:
    """An arm with more shapes, or with pairs that a file of MoveIt leaves out.

    Args:
        arm: The arm.
        shapes: The shapes.
        srdf: The .srdf file.
    """
    if not shapes and srdf is None:
        return arm
    return arm.with_shapes(partial(_add, arm, shapes, srdf))


def _add(arm: Arm, shapes: tuple[LinkShape, ...], srdf: FilePath | None) -> ArmShapes:
    """The shapes of an arm and more of them."""
    # Loaded with the compiled code of motions, which an arm alone does not need.
    from armcontour.clearance.touching import leave_out_touching

    known = arm.shapes or ArmShapes(shapes=())
    every = (*known.shapes, *shapes)
    left_out = known.left_out
    if srdf is not None:
        names = list(dict.fromkeys(x.name for x in every))
        left_out = (*left_out, *read_left_out(srdf, names))
    found = ArmShapes(shapes=every, left_out=left_out, source=known.source)
    return leave_out_touching(arm.with_shapes(found)) if every else found
