"""Figures in space: curves, axes of equal scale, and bodies of the cell and of the arm's base."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.jobs import Job
from armcontour.report.figure import make_trace
from armcontour.report.style import finish, line
from armcontour.robot import Arm
from armcontour.robot.scene import BASE, Box, Capsule, Cylinder, HalfSpace, Mesh, Shape, Sphere

LINK_COLOUR, TOOL_COLOUR, OBSTACLE_COLOUR = "#56B4E9", "#E69F00", "#999999"
# Minimum ratio of the shortest to the longest side of a scene.
FLATTEST = 0.4
# Length of the longest side of a scene in units of plotly, with which the scene fits in every view.
SCENE_SIZE = 1.45
# Camera with parallel projection, so that equal lengths appear equal.
CAMERA = {
    "eye": {"x": 1.1, "y": -1.5, "z": 0.9},
    "up": {"x": 0, "y": 0, "z": 1},
    "center": {"x": 0, "y": 0, "z": 0},
    "projection": {"type": "orthographic"},
}
# Number of points on the circumference of a round shape.
CIRCLE_POINTS = 24
# Maximum number of points of a mesh whose hull the page computes. For more points, scipy computes
# the hull, although loading scipy takes 0.3 s.
FEW_POINTS = 1000
# Size of the plate that represents a half-space, as a factor of the size of all other points.
PLATE_FACTOR = 1.5


def curve(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """Trace of a curve through points [m], (n, 2) or (n, 3)."""
    if points.shape[1] == 2:
        x, y = points.T * 1e3
        return line(x, y, name, colour, **look)
    look["width"] = look.get("width", 2) + 2
    return line_in_space(points * 1e3, name, colour, **look)


def line_in_space(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """Trace of a curve in space through points [mm], (n, 3), rounded to 0.1 µm."""
    line = {"color": colour, "width": look.pop("width", 4), "dash": look.pop("dash", "solid")}
    x, y, z = np.round(points, 4).astype(np.float32).T
    hover = "x %{x:.3f} mm<br>y %{y:.3f} mm<br>z %{z:.3f} mm"
    return make_trace(
        "scatter3d", x=x, y=y, z=z, name=name, mode="lines", line=line, hovertemplate=hover, **look
    )


def in_space(
    figure: Any, points: FloatArray, *, title: str, height: int, top: int = 12, span: int = 6
) -> None:
    """Set the layout of a figure in space for points [mm], (n, 3), with axes of equal scale."""
    finish(figure, title=title, height=height, span=span)
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = high - low
    longest = float(size.max())
    # A flat scene gets a margin, because the tick labels of its short axis would overlap.
    edge = np.maximum(FLATTEST * longest - size, 0.0) / 2 + 0.03 * longest
    size = size + 2 * edge
    ratio = size / float(size.max()) * SCENE_SIZE
    axis = {
        "nticks": 6,
        "backgroundcolor": "#FAFAFA",
        "gridcolor": "#DDDDDD",
        "zerolinecolor": "#DDDDDD",
    }
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
            "camera": CAMERA,
            **{
                f"{x}axis": {"title": {"text": f"{x} [mm]"}, "range": [a, b], **axis}
                for x, a, b in zip(
                    "xyz", (low - edge).tolist(), (high + edge).tolist(), strict=True
                )
            },
        },
        legend={
            "orientation": "v",
            "x": 0,
            "xref": "paper",
            "xanchor": "left",
            "yref": "paper",
            "y": 1,
            "yanchor": "top",
            "bgcolor": "rgba(255,255,255,0.8)",
        },
        margin={"l": 10, "r": 10, "t": top, "b": 10},
    )


def base_of(arm: Arm) -> Frame:
    """Pose of the arm's base in the work frame, which is the frame of the paths."""
    return Frame() if arm.chain is None else arm.chain.base


def seen_from_base(arm: Arm, points: FloatArray) -> FloatArray:
    """Transform points from the work frame [m] to the base frame of the arm [mm], (n, 3)."""
    frame = base_of(arm).inverse
    return np.asarray((frame.position + points @ frame.rotation.T) * 1e3)


def draw_surroundings(job: Job, points: FloatArray) -> list[tuple[Any, FloatArray]]:
    """Traces of the obstacles and of the arm's base, each with its points [mm], (n, 3).

    If there are no obstacles, the plane of the base is drawn. `points`: all other points of the
    drawing in the base frame [mm], (n, 3).
    """
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = float((high - low).max()) / 1e3
    bodies = []
    to_base = base_of(job.arm).inverse
    for obstacle in () if job.scene is None else job.scene.obstacles:
        place = obstacle.place if obstacle.fixed_to == BASE else to_base @ obstacle.place
        corners = points_of(obstacle.shape, place, PLATE_FACTOR * size)
        bodies.append((draw_body(corners, obstacle.name, OBSTACLE_COLOUR, 0.45), corners))
    if not bodies:
        obstacle, y = (z.ravel() for z in np.meshgrid([low[0], high[0]], [low[1], high[1]]))
        corners = np.column_stack([obstacle, y, 0 * obstacle])
        # The plate has a thickness of 1 mm, because a hull requires a volume.
        plate = np.concatenate([corners, corners - [0.0, 0.0, 1.0]])
        bodies.append((draw_body(plate, "plane of the base", OBSTACLE_COLOUR, 0.25), corners))
    return [*bodies, *_base_shapes(job.arm)]


def _base_shapes(arm: Arm) -> list[tuple[Any, FloatArray]]:
    """Traces of the shapes of the arm's base, each with its points [mm], (n, 3)."""
    if not arm.knows_shapes or arm.shapes is None:
        return []
    shapes = [x for x in arm.shapes.shapes if x.link == 0 and not x.tool]
    corners = [points_of(x.shape, x.place) for x in shapes]
    return [
        (draw_body(points, x.name, LINK_COLOUR, 0.6), points)
        for x, points in zip(shapes, corners, strict=True)
    ]


def draw_body(points: FloatArray, name: str, colour: str, opacity: float) -> Any:
    """Trace of the convex hull of points [mm], (n, 3)."""
    x, y, z = np.round(points, 2).T
    return make_trace(
        "mesh3d",
        x=x, y=y, z=z, alphahull=0, name=name, color=colour, opacity=opacity, hoverinfo="name",
        flatshading=True, showlegend=False,
    )  # fmt: skip


def points_of(shape: Shape, place: Frame, size: float = 1.0) -> FloatArray:
    """Points whose convex hull is a shape at a pose [mm], (n, 3)."""
    points = _own_points(shape, size)
    return np.asarray((place.position + points @ place.rotation.T) * 1e3)


def _own_points(shape: Shape, size: float) -> FloatArray:
    """Points whose hull is a shape in its own frame [m], (n, 3); a half-space becomes a plate."""
    turn = np.linspace(0, 2 * np.pi, CIRCLE_POINTS, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    match shape:
        case Mesh() if len(shape.points) <= FEW_POINTS:
            return shape.points
        case Mesh():
            # Only the vertices of the hull are drawn, because a mesh can have a million points.
            from scipy.spatial import ConvexHull

            return np.asarray(shape.points[ConvexHull(shape.points).vertices])
        case Box():
            signs = np.array(list(product((-1, 1), repeat=3)))
            return np.asarray(signs * shape.size / 2)
        case HalfSpace():
            signs = np.array(list(product((-1, 1), (-1, 1), (-0.005, 0))))
            return np.asarray(signs * size / 2)
        case Cylinder():
            ends = [circle * shape.radius + k * shape.length / 2 * up for k in (-1, 1)]
            return np.concatenate(ends)
        case Sphere() | Capsule():
            half = shape.length / 2 if isinstance(shape, Capsule) else 0.0
            tilts = np.linspace(-np.pi / 2, np.pi / 2, CIRCLE_POINTS // 2)
            rings = [
                shape.radius * (np.cos(x) * circle + np.sin(x) * up) + np.sign(x) * half * up
                for x in tilts
            ]
            return np.concatenate(rings)
    raise TypeError(f"A shape of type {type(shape).__name__} cannot be drawn.")
