"""Creation of the path or program that the key `path` of a job file describes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import product
from pathlib import Path as FilePath
from typing import Literal

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context, key_context
from armcontour.core.frames import Frame
from armcontour.core.progress import Progress
from armcontour.core.text import Keys, key_text, list_some
from armcontour.files.drawings.read_options import MAX_COORDINATE, ReadOptions
from armcontour.files.job_arm import frame_of
from armcontour.files.job_model import OrientationModel, PathModel, RepeatModel, SegmentModel
from armcontour.files.model.edge_rules import MODELS
from armcontour.files.model.tool_axis import BISECTOR, Bisector
from armcontour.files.scene_file import PartsModel, rotation_of
from armcontour.geometry import Arc, Line, Path, SegmentLimits
from armcontour.program import Contour, Move, Program, contour_called, set_limits
from armcontour.program.moves import name_copy
from armcontour.robot.scene import Obstacle

# Keys of `path.contours` that are not values of the process.
CONTOUR_LIMITS = ("speed", "tolerance", "order")
# Maximum number of contour names in a message.
MAX_NAMES = 12
# Keys that require `path.file`.
FILE_OPTIONS = (*(x.name for x in dataclasses.fields(ReadOptions)), "repeat")
NOT_PLANAR = (
    "path.frame moves the drawing out of the plane in which the arm moves its tool. Specify a "
    "position with z = 0, and a rotation about z only, by the last angle of rpy."
)
ONE_ORIENTATION = (
    "path.orientation must be a single mapping for a file, not a list, because all contours have "
    "the same orientation."
)
# Begin of the note on an orientation of the job that has no effect.
ORIENTATION_IGNORED = "path.orientation is ignored"
# Keys of an orientation, of which exactly one must be specified.
ORIENTATIONS = ("rpy", "quaternion", "axis", "follow_tangent", "bisector", "face")
# Those that follow the faces at the edges of a model.
OF_FACES = ("bisector", "face")


def path_of(
    model: PathModel,
    folder: FilePath,
    dimension: int,
    progress: Progress | None = None,
    drawing: Program | None = None,
) -> Path | Program:
    """Make the objective path or program of a job, with the tool orientation if it is specified.

    Args:
        model: Keys of the path.
        folder: Folder against which relative file names are resolved.
        dimension: 2 for an arm in the plane, 3 for an arm in space.
        progress: Called with the progress of reading the drawing.
        drawing: Program of the drawing, if it is already read.

    Raises:
        InvalidInput: A value is wrong, the drawing cannot be read, or a path in space is for an arm
            in the plane.
    """
    unplaced = unplaced_path(model, folder, dimension, progress, drawing)
    return placed_path(model, unplaced, dimension)


def unplaced_path(
    model: PathModel,
    folder: FilePath,
    dimension: int,
    progress: Progress | None = None,
    drawing: Program | None = None,
) -> Path | Program:
    """Return the path or program in its own coordinates, before the transform by `path.frame`."""
    if model.file is not None:
        if any(x is not None for x in (model.points, model.start, model.segments)):
            raise InvalidInput(
                "path requires exactly one of file, points, and start with segments."
            )
        if drawing is None:
            drawing = read_drawing(model, model.file, folder, progress)
        return _prepare_drawing(model, drawing, dimension)
    has_path = any(x is not None for x in (model.points, model.segments))
    file_options = FILE_OPTIONS if has_path else (*FILE_OPTIONS, "frame")
    for field in dataclasses.fields(model):
        if field.name in file_options and getattr(model, field.name) != field.default:
            raise InvalidInput(
                f"path.{field.name} is an option for reading a file and requires path.file. If "
                "this job is a cell, specify a drawing (armcontour run DRAWING --cell CELL)."
            )
    return _path_from_keys(model)


def placed_path(model: PathModel, path: Path | Program, dimension: int) -> Path | Program:
    """Return the path or program of `unplaced_path`, transformed by `path.frame`."""
    frame = part_of(model)
    if dimension == 2 and path.dimension == 2 and not frame.is_planar_transform:
        raise InvalidInput(NOT_PLANAR)
    if isinstance(path, Program) or model.frame is not None:
        path = path.placed(frame)
    return _set_contour_limits(Program.from_path(path), model) if model.contours else path


def _set_contour_limits(program: Program, model: PathModel) -> Program:
    """Return the program with the speeds, tolerances and order of the key `path.contours`."""
    key_of_contour, notes = find_contours(program, model)
    moves = list[Move](program.moves)
    for i, move in enumerate(moves):
        if isinstance(move, Contour) and move.number in key_of_contour:
            values = model.contours[key_of_contour[move.number]]
            speed, tolerance, order = (values.get(x) for x in CONTOUR_LIMITS)
            limits = SegmentLimits(speed=speed, tolerance=tolerance)
            path = set_limits(move.path, limits, override=True)
            moves[i] = dataclasses.replace(move, path=path, order=order or 0)
    return dataclasses.replace(program, moves=tuple(moves), notes=(*program.notes, *notes))


def find_contours(program: Program, model: PathModel) -> tuple[dict[int, int | str], list[str]]:
    """Return the key in `path.contours` by number of the contour, and notes on unused keys."""
    contours = program.contours
    notes = list[str]()
    key_of_contour = dict[int, int | str]()
    # A name has priority over a number, and can be the name of several contours.
    numbers_of_name = {x.name: list[int]() for x in contours if x.name}
    for contour in contours:
        numbers_of_name.get(contour.name, []).append(contour.number)
    numbers_of_key = {str(x.number): [x.number] for x in contours} | numbers_of_name
    for key in model.contours:
        numbers = numbers_of_key.get(str(key), [])
        problem = ""
        if same := [key_of_contour[x] for x in numbers if x in key_of_contour]:
            problem = f"is the same contour as {same[0]}. Combine their values."
        elif not numbers and (program.other_layers or model.names or model.colors):
            notes.append(f"path.contours.{key} has no effect, because this contour is not run.")
        elif not numbers:
            names = list(map(repr, numbers_of_name))
            and_names = f" and the names {list_some(names, MAX_NAMES)}" if names else ""
            problem = f"is not in {program.source or 'the path'}, whose contours have the numbers "
            problem += f"1 to {len(contours)}{and_names}."
        if problem:
            at = ("path", "contours", str(key))
            raise InvalidInput(f"{key_text(at)} {problem}", key=at)
        key_of_contour |= dict.fromkeys(numbers, key)
    return key_of_contour, notes


def _path_from_keys(model: PathModel) -> Path:
    """Return the path of a job without a file, with the tool orientation if it is specified."""
    path = _unoriented_path(model)
    if model.orientation is None:
        return path
    if isinstance(model.orientation, OrientationModel):
        return _orient(path, model.orientation, "path.orientation")
    return _orient_waypoints(path, model.orientation)


def _check_planar(model: PathModel, program: Program) -> None:
    """Check that a planar arm can follow a drawing, which must have no z and no orientation."""
    if program.dimension == 3:
        raise InvalidInput(
            f"path.file: {program.source} has z coordinates, but the arm is planar. Ignore them "
            "with path.ignore_z: true (on the command line --ignore-z), or use an arm in space."
        )
    if model.orientation is not None:
        raise InvalidInput("path.orientation requires an arm in space, but the arm is planar.")


def read_drawing(
    model: PathModel, file: str, folder: FilePath, progress: Progress | None = None
) -> Program:
    """Read the program of a drawing with the options in the key `path` of a job.

    Args:
        model: Keys of the path.
        file: Name of the drawing's file.
        folder: Folder against which this name is resolved.
        progress: Called with the progress.

    Raises:
        InvalidInput: As in `read_path`; the error has the key `path.file`.
    """
    from armcontour.files.drawings.path_reader import read_path

    # With `repeat`, `names` can be names of copies, so `_repeat` selects them.
    options = model if model.repeat is None else dataclasses.replace(model, names=None)
    if is_model(model):
        options = dataclasses.replace(options, tool_axis=tool_axis_of(model))
        if model.repeat is not None:
            raise InvalidInput(
                "path.repeat is not supported for CAD models. Repeat the part in the CAD program.",
                key=("path", "repeat"),
            )
    with error_context("", "path", "file"):
        return read_path(folder / file, options, progress=progress)


def is_model(model: PathModel) -> bool:
    """Return whether the path's file is a CAD model."""
    return model.file is not None and FilePath(model.file).suffix.lower() in MODELS


def tool_axis_of(model: PathModel) -> Bisector | None:
    """Return the tool axis that follows the faces of a CAD model; None for other orientations.

    Raises:
        InvalidInput: The orientation is a list, or has not exactly one form.
    """
    orientation = model.orientation
    if orientation is None:
        return BISECTOR
    if not isinstance(orientation, OrientationModel):
        raise InvalidInput(ONE_ORIENTATION, key=("path", "orientation"))
    if orientation.cone > 0.0 and not _names_of(orientation):
        return BISECTOR
    _check_single_rotation(("path", "orientation"), orientation)
    return orientation.bisector if orientation.face is None else orientation.face


def parts_of(
    model: PathModel, folder: FilePath, parts: PartsModel | Literal["none"] | None
) -> tuple[Obstacle, ...]:
    """Return the parts of the path's CAD model as obstacles in the frame of the part.

    Args:
        model: Keys of the path.
        folder: Folder against which relative file names are resolved.
        parts: The key `scene.model`.

    Raises:
        InvalidInput: The path's file is no CAD model, but `parts` has keys; or as in `read_model`.
    """
    if not is_model(model):
        if isinstance(parts, PartsModel):
            raise InvalidInput(
                "scene.model requires a CAD model (.step, .stp) as path.file. Remove scene.model."
            )
        return ()
    if parts == "none":
        return ()
    from armcontour.files.drawings.step import read_parts

    keys = parts or PartsModel()
    return read_parts(folder / str(model.file), model, margin=keys.margin, allow=keys.allow)


def _prepare_drawing(model: PathModel, program: Program, dimension: int) -> Program:
    """Repeat a drawing, lift it to space, and orient the tool."""
    if model.repeat is not None:
        program = _repeat(program, model.repeat, model.names)
    if dimension == 2:
        _check_planar(model, program)
        return program
    program = program.mapped(Path.lifted)
    if model.orientation is not None:
        orientation = model.orientation
        if not isinstance(orientation, OrientationModel):
            raise InvalidInput(ONE_ORIENTATION, key=("path", "orientation"))
        if any(x.path.orientation is not None for x in program.contours):
            return _keep_orientations(model, program, orientation)
        program = _orient_contours(program, orientation)
    return program


def _keep_orientations(
    model: PathModel, program: Program, orientation: OrientationModel
) -> Program:
    """Return a program with the tool orientations of its file, and with the cone of the job."""
    follows_faces = is_model(model) and tool_axis_of(model) is not None
    if not follows_faces and _names_of(orientation):
        note = f"{ORIENTATION_IGNORED}, because {program.source} has tool orientations."
        if orientation.cone > 0.0:
            note = note.replace("is ignored", "is ignored except for its cone")
        program = dataclasses.replace(program, notes=(*program.notes, note))
    if orientation.cone == 0.0:
        return program
    with key_context("path", "orientation", "cone"):
        return program.with_cone(orientation.cone)


def part_of(model: PathModel) -> Frame:
    """Return the frame of the part: `path.frame`, or the zero frame if it is missing."""
    if model.frame is None:
        return Frame()
    with error_context("", "path", "frame"):
        return frame_of("path.frame", model.frame)


def _repeat(program: Program, grid: RepeatModel, names: Sequence[str] | None) -> Program:
    """Repeat a program in a grid; `names` selects single copies, or all copies of a contour."""
    with key_context("path", "repeat"):
        copies = program.repeated(**dataclasses.asdict(grid))
    if names is None:
        return copies
    drawn = {x.name for x in program.contours}
    chosen = []
    for name in names:
        if name in drawn:
            cells = product(range(grid.rows), range(grid.columns))
            chosen += [name_copy(name, row, column) for row, column in cells]
        else:
            chosen.append(name)
    return copies.selected(names=chosen)


def _orient_contours(program: Program, orientation: OrientationModel) -> Program:
    """Give every contour of a program the same tool orientation."""
    moves = list(program.moves)
    number = 0
    for i, move in enumerate(moves):
        if not isinstance(move, Contour):
            continue
        location = f"path.orientation, {contour_called(move, number)}"
        moves[i] = dataclasses.replace(move, path=_orient(move.path, orientation, location))
        number += 1
    return dataclasses.replace(program, moves=tuple(moves))


def _unoriented_path(model: PathModel) -> Path:
    """Return the path of a job without a drawing, without tool orientation.

    The path is the polyline of `path.points`, or the lines and arcs of `path.segments`.
    """
    has_points = model.points is not None
    has_segments = model.segments is not None
    if has_points == has_segments or has_segments != (model.start is not None):
        raise InvalidInput("path requires exactly one of points, start with segments, and file.")
    if model.points is not None:
        points = _to_array(model.points)
        with key_context("path", "points"):
            return Path.polyline(points)
    assert model.start is not None and model.segments is not None
    return _segment_chain(model.start, model.segments)


def _to_array(points: list[list[float]]) -> FloatArray:
    """Check the key `points` and return it as an array [m], (n, 2) or (n, 3)."""
    if not points:
        raise InvalidInput("path.points is empty, but a path needs at least two points.")
    if len({len(x) for x in points}) > 1:
        raise InvalidInput("path.points must all have 2 or all have 3 coordinates.")
    for i, point in enumerate(points):
        _check_range(("path", "points", i), point)
    return np.array(points).reshape(len(points), -1)


def _check_range(keys: Keys, point: Sequence[float]) -> None:
    """Check that coordinates [m] are at most MAX_COORDINATE, so that rounding errors are small."""
    far = max(map(abs, point), default=0.0)
    if far > MAX_COORDINATE:
        raise InvalidInput(
            f"{key_text(keys)} has a coordinate of {far:.3g} m, but at most {MAX_COORDINATE:g} m "
            "are allowed. Check its unit.",
            key=keys,
        )


def _segment_chain(start: list[float], models: list[SegmentModel]) -> Path:
    """Make the path that a chain of lines and arcs describes from a start point."""
    if not models:
        raise InvalidInput("path.segments is empty, but a path needs at least one segment.")
    segments: list[Line | Arc] = []
    point = list(start)
    _check_range(("path", "start"), point)
    for i, segment in enumerate(models):
        for name in ("to", "via", "center"):
            _check_range(("path", "segments", i, name), getattr(segment, name) or ())
        segments.append(_segment(point, segment, ("path", "segments", i)))
        point = list(segment.to) if segment.to is not None else _end(segments)
    with key_context("path", "segments"):
        return Path(segments=segments)


def _end(segments: list[Line | Arc]) -> list[float]:
    """Return the end point of the last segment [m], as a list of coordinates."""
    try:
        (*_, end) = Path(segments=segments[-1:]).vertices.tolist()
    except InvalidInput:
        # Raise the error again, with the number of the segment in the whole path.
        with key_context("path", "segments"):
            (*_, end) = Path(segments=segments).vertices.tolist()
    return list(end)


def _segment(start: list[float], segment: SegmentModel, keys: Keys) -> Line | Arc:
    """Return the line or arc of a model, from a start point."""
    segment_limits = SegmentLimits(
        **{x.name: getattr(segment, x.name) for x in dataclasses.fields(SegmentLimits)}
    )
    centre_keys = (segment.center, segment.angle, segment.normal)
    if segment.to is not None and all(x is None for x in centre_keys):
        if segment.via is None:
            return Line(start=start, end=segment.to, segment_limits=segment_limits)
        with key_context(*keys):
            return Arc.through(start, segment.via, segment.to, segment_limits=segment_limits)
    if (
        segment.to is None
        and segment.via is None
        and segment.center is not None
        and segment.angle is not None
    ):
        return Arc(
            start=start,
            center=segment.center,
            angle=segment.angle,
            normal=segment.normal,
            segment_limits=segment_limits,
        )
    raise InvalidInput(
        f"{key_text(keys)} requires either to (a line), or via and to (an arc through points), or "
        "center and angle (an arc).",
        key=keys,
    )


def _orient(path: Path, orientation: OrientationModel, location: str) -> Path:
    """Give a path one tool orientation for its whole length; `location` is for messages."""
    _check_single_rotation(("path", "orientation"), orientation)
    for name in OF_FACES:
        if getattr(orientation, name) is not None:
            raise InvalidInput(
                f"path.orientation.{name} requires a CAD model (.step, .stp) as path.file.",
                key=("path", "orientation", name),
            )
    follow = orientation.follow_tangent
    key = "path.orientation" if follow is None else "path.orientation.follow_tangent"
    rotation = rotation_of(key, orientation if follow is None else follow)
    with error_context(location, "path", "orientation"):
        if orientation.axis is not None:
            oriented = path.pointing(orientation.axis)
        elif follow is not None:
            free = orientation.axis_only
            oriented = path.following_tangent(follow.up, tool=rotation, axis_only=free)
        else:
            oriented = path.oriented(rotation, axis_only=orientation.axis_only)
    with key_context("path", "orientation", "cone"):
        return oriented.with_cone(orientation.cone)


def _orient_waypoints(path: Path, models: list[OrientationModel]) -> Path:
    """Return the path with one tool orientation per waypoint."""
    for i, orientation in enumerate(models):
        key = key_text(("path", "orientation", i))
        _check_single_rotation(("path", "orientation", i), orientation)
        for name in ("follow_tangent", *OF_FACES):
            if getattr(orientation, name) is not None:
                raise InvalidInput(
                    f"{key}: {name} applies to the whole path. Write it as a single mapping, not "
                    "in a list."
                )
    if not models:
        raise InvalidInput(
            "path.orientation is an empty list, but must have one orientation per waypoint."
        )
    axes = [x.axis for x in models if x.axis is not None]
    if len(axes) == len(models):
        with key_context("path", "orientation"):
            return path.pointing(np.array(axes)).with_cone(_only_cone(models))
    if axes or len({x.axis_only for x in models}) > 1:
        raise InvalidInput(
            "path.orientation: either all waypoints must have axis, or none. The same is required "
            "for axis_only."
        )
    rotations = [rotation_of(key_text(("path", "orientation", i)), x) for i, x in enumerate(models)]
    with key_context("path", "orientation"):
        oriented = path.oriented(np.array(rotations), axis_only=models[0].axis_only)
        return oriented.with_cone(_only_cone(models))


def _only_cone(models: list[OrientationModel]) -> float:
    """Return the cone of all waypoints [rad], which must be the same."""
    cones = sorted({x.cone for x in models})
    if len(cones) > 1:
        raise InvalidInput(
            f"path.orientation has cones from {np.degrees(cones[0]):.4g} to "
            f"{np.degrees(cones[-1]):.4g} deg, but a path has one cone. Specify the same cone for "
            "all waypoints."
        )
    return cones[0]


def _names_of(orientation: OrientationModel) -> list[str]:
    """Return the keys of ORIENTATIONS that are specified."""
    return [name for name in ORIENTATIONS if getattr(orientation, name) is not None]


def _check_single_rotation(keys: Keys, orientation: OrientationModel) -> None:
    """Check that an orientation has exactly one of the keys ORIENTATIONS."""
    names = _names_of(orientation)
    if len(names) != 1:
        raise InvalidInput(
            f"{key_text(keys)} requires exactly one of {', '.join(ORIENTATIONS)}, but has "
            f"{' and '.join(names) or 'none'}.",
            key=keys,
        )
