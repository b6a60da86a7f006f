"""Values that replace those of a job file, such as options of the command line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.geometry import Demand
from armcontour.geometry.rounding import CONTINUITIES, Continuity
from armcontour.io.job_arm import named_arm
from armcontour.io.job_model import (
    ArmModel,
    FrameModel,
    JobModel,
    PathModel,
    RunModel,
)
from armcontour.jobs import Rounding
from armcontour.jobs.job import ARC, OF_FREE, SHAPES
from armcontour.motion import Method
from armcontour.program import Process


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOverrides:
    """Values that replace those of a job; None keeps the job's own value.

    Args:
        units: Unit of the drawing's lengths.
        columns: Names of the columns of a table of waypoints.
        scale: Factor of the drawing's lengths.
        position: Position of the drawing's origin [m], (3,).
        turn: Roll, pitch and yaw of the drawing [rad], (3,).
        layers: Layers to run.
        names: Contours to run.
        colors: Colours of DXF entities, or of strokes in SVG, to run.
        flat: Whether to leave z out.
        texts: What becomes of the texts of DXF.
        skip_unknown: Whether to skip elements that the reader does not know.
        skip_words: Words and codes of G-code to leave out, such as M6.
        tools: Diameters of tools for G-code [m], by their numbers.
        tool: Name of the tool whose contours are run, such as T2.
        speed: Assigned velocity where the drawing gives none [m/s]; replaces the speed of runs,
            too.
        corner_tolerance: Largest corner error where the drawing gives none [m]; replaces the
            tolerance of runs, too. Runs without rounding keep sharp corners.
        corner_shape: Shape of the corners of all runs with the timing optimal that round corners,
            "arc" or "free".
        line_tolerance: Largest distance from the objective farther than `zone` from corners, for
            the shape free [m].
        zone: Distance from a corner within which the tolerance holds, for the shape free [m].
        iterations: Largest number of steps of the search for the shape free.
        continuity: What is continuous along corners, for all runs with the timing optimal that
            round them with arcs: "tangent" or "curvature".
        from_s: Position at which to resume, as arc length over all contours [m].
        arm: Name of a built-in arm, or an arm file, in the place of the job's arm; tool, work frame
            and payload stay.
        ignore_collisions: Whether runs go on where the arm comes too near to itself or to its cell.
    """

    units: str | None = None
    columns: str | None = None
    scale: float | None = None
    position: tuple[float, ...] | None = None
    turn: tuple[float, ...] | None = None
    layers: tuple[str, ...] | None = None
    names: tuple[str, ...] | None = None
    colors: tuple[str, ...] | None = None
    flat: bool = False
    texts: str | None = None
    skip_unknown: bool = False
    skip_words: tuple[str, ...] | None = None
    tools: dict[int, float] | None = None
    tool: str | None = None
    speed: float | None = None
    corner_tolerance: float | None = None
    corner_shape: str | None = None
    line_tolerance: float | None = None
    zone: float | None = None
    iterations: int | None = None
    continuity: str | None = None
    from_s: float | None = None
    arm: str | None = None
    ignore_collisions: bool = False


def override(model: JobModel, x: JobOverrides | None) -> JobModel:
    """Replace values of a job file.

    Args:
        model: The keys of the file.
        x: The values to replace.

    Raises:
        InvalidInput: An invalid value.
    """
    if x is None:
        return model
    changes: dict[str, Any] = {
        "path": _path(model.path, x),
        "runs": {name: _run(run, x) for name, run in model.runs.items()},
    }
    if x.speed is not None:
        changes["limits"] = {**model.limits, "speed": x.speed}
    if x.corner_tolerance is not None:
        own = model.corners if isinstance(model.corners, Rounding) else Rounding()
        changes["corners"] = replace(own, tolerance=x.corner_tolerance)
    changes["runs"] = _shaped(changes["runs"], changes.get("corners", model.corners), x)
    changes["runs"] = _continued(changes["runs"], changes.get("corners", model.corners), x)
    if x.from_s is not None:
        changes["process"] = replace(model.process or Process(), from_s=x.from_s)
    if x.ignore_collisions:
        changes["ignore_collisions"] = True
    if x.arm is not None:
        before = model.arm if isinstance(model.arm, ArmModel) else named_arm(model.arm)
        changes["arm"] = replace(
            named_arm(x.arm), tool=before.tool, work=before.work, payload=before.payload
        )
    return replace(model, **changes)


def _run(run: RunModel, x: JobOverrides) -> RunModel:
    """Replace the speed and the corner tolerance that a run itself gives."""
    if x.speed is not None and "speed" in run.limits:
        run = replace(run, limits={**run.limits, "speed": x.speed})
    own = run.corners
    if x.corner_tolerance is None or not isinstance(own, Rounding) or own.tolerance is None:
        return run
    return replace(run, corners=replace(own, tolerance=x.corner_tolerance))


def _shaped(
    runs: dict[str, RunModel], corners: Rounding | str, x: JobOverrides
) -> dict[str, RunModel]:
    """The runs with another shape of the corners, for those that can have it.

    Args:
        runs: The runs by their names, with other values replaced already.
        corners: The corners of the job, for runs without corners of their own.
        x: The values to replace.

    Raises:
        InvalidInput: No run rounds corners with the timing optimal.
    """
    wanted = {name: getattr(x, name) for name in OF_FREE if getattr(x, name) is not None}
    if x.corner_shape is None and not wanted:
        return runs
    if x.corner_shape is not None:
        wanted["shape"] = _checks.choice("--corner-shape", x.corner_shape, SHAPES)
    found = {}
    for name, run in runs.items():
        own = corners if run.corners is None else run.corners
        if run.timing.method == Method.OPTIMAL and isinstance(own, Rounding):
            base = own.with_arcs if x.corner_shape == ARC else own.without_continuity
            found[name] = replace(run, corners=replace(base, **wanted))
    if not found:
        raise InvalidInput(
            "No run has both rounded corners and the timing optimal, so that none takes another "
            "shape of the corners: give a run corners and timing: {method: optimal}, or "
            "--tolerance if only the corners are missing."
        )
    return {**runs, **found}


def _continued(
    runs: dict[str, RunModel], corners: Rounding | str, x: JobOverrides
) -> dict[str, RunModel]:
    """The runs with another continuity of their corners, for those that have arcs; as `_shaped`.

    Raises:
        InvalidInput: No run has it.
    """
    if x.continuity is None:
        return runs
    wanted = cast(Continuity, _checks.choice("--continuity", x.continuity, CONTINUITIES))
    found = {}
    for name, run in runs.items():
        own = corners if run.corners is None else run.corners
        if run.timing.method == Method.OPTIMAL and isinstance(own, Rounding) and not own.free:
            found[name] = replace(run, corners=replace(own, continuity=wanted))
    if not found:
        raise InvalidInput(
            "No run has both corners rounded with arcs and the timing optimal, so that none takes "
            "--continuity: leave it out, or give a run corners and timing: {method: optimal}."
        )
    return {**runs, **found}


def _path(path: PathModel, x: JobOverrides) -> PathModel:
    """Replace options for reading the drawing, and its frame."""
    changes: dict[str, Any] = {
        "units": x.units,
        "columns": x.columns,
        "scale": x.scale,
        "names": None if x.names is None else list(x.names),
        "colors": None if x.colors is None else list(x.colors),
        "flat": x.flat or None,
        "texts": x.texts,
        "tools": x.tools,
        "tool": x.tool,
        "unknown": {"skip": list(x.skip_words)}
        if x.skip_words
        else ("skip" if x.skip_unknown else None),
    }
    if x.layers is not None:
        own = path.layers if isinstance(path.layers, dict) else {}
        changes["layers"] = {name: own.get(name, Demand()) for name in x.layers}
    frame = path.frame or FrameModel()
    if x.position is not None:
        changes["frame"] = frame = replace(frame, position=list(x.position))
    if x.turn is not None:
        changes["frame"] = replace(frame, rpy=list(x.turn))
    return replace(path, **{key: value for key, value in changes.items() if value is not None})
