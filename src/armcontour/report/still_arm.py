"""A still picture of an arm in its cell as SVG, for paper and for browsers without WebGL."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.frames import exp
from armcontour.report.message_frame import MessageFrame

# Direction from which the picture looks, as in the view "Cell" of the viewer [rad].
AZIMUTH = -0.7
ELEVATION = 0.45
# Size of the picture [px]; its points are rounded to pixels.
WIDTH = 900.0
HEIGHT = 750.0
# Margin of the picture [px].
EDGE = 22.0
# Smaller triangles are not drawn [px²].
SMALLEST_AREA = 2.0
# Number of shades per colour.
SHADES = 10
# Brightness of a surface that faces away from the light; 1 faces the light.
AMBIENT = 0.55
# Direction to the light along the axes of the picture: right, up, towards the eye.
LIGHT = np.array([-0.35, 0.6, 0.72])
# Colours of bodies by kind (red, green, blue).
COLOURS = {
    "link": (228, 233, 238),
    "joint": (143, 179, 205),
    "tool": (90, 98, 110),
    "axis": (170, 178, 188),
    "obstacle": (196, 178, 150),
    "part": (214, 196, 160),
}
# Names of links that are drawn as joints, as in the viewer.
JOINTS = re.compile(r"wrist|shoulder|[357]$")


class _Facets(NamedTuple):
    """Projected triangles: points [px], depth towards the eye, colour; (n, 3, 2), (n,), (n,)."""

    points: FloatArray
    depths: FloatArray
    colours: npt.NDArray[Any]


def draw_still(arm: MessageFrame, q: FloatArray, lines: Sequence[tuple[str, FloatArray]]) -> str:
    """Draw an arm at joint positions, with lines in the work frame, as SVG without a size.

    Args:
        arm: Frame of `arm_frame`.
        q: Joint positions [rad], (dof,).
        lines: Colour and points of each line [m], (n, 3).
    """
    links = _link_poses(arm.header["joints"], q)
    work = links[arm.header["part"]["link"]] @ arm.header["part"]["at"]
    axes = _picture_axes()
    bodies = []
    for body in arm.header["bodies"]:
        kind = body["colour"]
        if kind == "table":
            # A table would fill the picture.
            continue
        if kind == "link" and JOINTS.search(body["name"]):
            kind = "joint"
        pose = links[body["link"]] @ body["at"]
        triangles = arm.arrays[body["triangles"]].astype(np.float64)
        bodies.append((kind, _move(triangles, pose) @ axes.T))
    moved = [(colour, _move(points, work) @ axes.T) for colour, points in lines]
    framed = [x.reshape(-1, 3) for _, x in (*bodies, *moved)]
    low = np.concatenate(framed)[:, :2].min(axis=0)
    high = np.concatenate(framed)[:, :2].max(axis=0)
    size = np.array([WIDTH, HEIGHT]) - 2 * EDGE
    scale = float(np.min(size / np.maximum(high - low, 1e-9)))
    middle = (low + high) / 2

    def place(points: FloatArray) -> FloatArray:
        flat = (points[..., :2] - middle) * scale * [1.0, -1.0]
        return np.asarray(flat + [WIDTH / 2, HEIGHT / 2])

    facets = [_facets(kind, x, place) for kind, x in bodies]
    parts = _paths(_Facets(*(np.concatenate(x) for x in zip(*facets, strict=True))))
    for colour, points in moved:
        d = " ".join(f"{x:.1f}" for x in place(points).ravel().tolist())
        parts.append(f'<path d="M{d}" fill="none" stroke="{colour}" stroke-width="3"/>')
    box = f"0 0 {WIDTH:.0f} {HEIGHT:.0f}"
    label = "The arm at the middle of its motion"
    inside = "".join(parts)
    return f'<svg class="still" role="img" aria-label="{label}" viewBox="{box}">{inside}</svg>'


def _picture_axes() -> FloatArray:
    """Return unit vectors to the right, up and towards the eye, (3, 3)."""
    sine, cosine = np.sin(ELEVATION), np.cos(ELEVATION)
    eye = np.array([cosine * np.cos(AZIMUTH), cosine * np.sin(AZIMUTH), sine])
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return np.stack([right, np.cross(eye, right), eye])


def _link_poses(joints: Sequence[Mapping[str, Any]], q: FloatArray) -> list[FloatArray]:
    """Return the pose of each link in the frame of the floor, (4, 4); link 0 is the floor."""
    poses = [np.eye(4)]
    for joint in joints:
        position = joint["factor"] * q[joint["column"]]
        motion = np.eye(4)
        if joint["type"] == "prismatic":
            motion[:3, 3] = position * joint["axis"]
        else:
            motion[:3, :3] = exp(position * np.asarray(joint["axis"]))
        poses.append(poses[joint["parent"]] @ joint["origin"] @ motion)
    return poses


def _move(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Return points [m], (..., 3), moved by a pose, (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _facets(kind: str, triangles: FloatArray, place: Any) -> _Facets:
    """Return the triangles of a body that face the eye, with the colours of their shades.

    `triangles`: corners along the axes of the picture [m], (n, 3, 3).
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    points = np.round(place(triangles))
    first = points[:, 1] - points[:, 0]
    second = points[:, 2] - points[:, 0]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    visible = (normals[:, 2] > 0) & (area > SMALLEST_AREA)
    normals = normals[visible]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.clip(normals @ LIGHT / np.linalg.norm(LIGHT), 0.0, 1.0)
    shade = np.round((AMBIENT + (1.0 - AMBIENT) * light) * SHADES) / SHADES
    colour = np.outer(shade, COLOURS[kind]).round().astype(int)
    colours = np.array(["#{:02x}{:02x}{:02x}".format(*x) for x in colour.tolist()], dtype="U7")
    return _Facets(points[visible], triangles[visible, :, 2].mean(axis=1), colours)


def _paths(facets: _Facets) -> list[str]:
    """Return SVG paths of triangles, the farthest first; neighbours of one colour share a path."""
    order = np.argsort(facets.depths, kind="stable")
    parts = []
    d = ""
    last = ""
    for k in order.tolist():
        colour = str(facets.colours[k])
        if d and colour != last:
            parts.append(_path(last, d))
            d = ""
        last = colour
        corners = " ".join(f"{x:.0f}" for x in facets.points[k].ravel().tolist())
        d += f"M{corners}z"
    if d:
        parts.append(_path(last, d))
    return parts


def _path(colour: str, d: str) -> str:
    # The stroke fills the seams between neighbours.
    return f'<path fill="{colour}" stroke="{colour}" stroke-width="1.2" d="{d}"/>'
