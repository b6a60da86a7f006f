"""Values that replace those of a job file, such as options of the command line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from armcontour.geometry import Demand
from armcontour.io.job_model import FrameModel, JobModel, PathModel, RunModel, SkipModel
from armcontour.jobs import Rounding
from armcontour.program import Process


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOverrides:
    """Values that replace those of a job; None keeps the job's own value.

    Args:
        units: Unit of the drawing's lengths.
        scale: Factor of the drawing's lengths.
        position: Position of the drawing's origin [m], (3,).
        turn: Roll, pitch and yaw of the drawing [rad], (3,).
        layers: Layers to run.
        names: Contours to run.
        colors: Colours of DXF entities, or of strokes in SVG, to run.
        flat: Whether to leave z out.
        skip_unknown: Whether to skip elements that the reader does not know.
        skip_words: Words and codes of G-code to leave out, such as M6.
        tools: Diameters of tools for G-code [m], by their numbers.
        speed: Assigned velocity where the drawing gives none [m/s]; replaces the speed of runs,
            too.
        corner_tolerance: Largest corner error where the drawing gives none [m]; replaces the
            tolerance of runs, too. Runs without rounding keep sharp corners.
        from_s: Position at which to resume, as arc length over all contours [m].
        memory: Largest memory of the calculation [bytes].
    """

    units: str | None = None
    scale: float | None = None
    position: tuple[float, ...] | None = None
    turn: tuple[float, ...] | None = None
    layers: tuple[str, ...] | None = None
    names: tuple[str, ...] | None = None
    colors: tuple[str, ...] | None = None
    flat: bool = False
    skip_unknown: bool = False
    skip_words: tuple[str, ...] | None = None
    tools: dict[int, float] | None = None
    speed: float | None = None
    corner_tolerance: float | None = None
    from_s: float | None = None
    memory: float | None = None


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
    if x.from_s is not None:
        changes["process"] = replace(model.process or Process(), from_s=x.from_s)
    if x.memory is not None:
        changes["memory"] = x.memory
    return replace(model, **changes)


def _run(run: RunModel, x: JobOverrides) -> RunModel:
    """Replace the speed and the corner tolerance that a run itself gives."""
    if x.speed is not None and "speed" in run.limits:
        run = replace(run, limits={**run.limits, "speed": x.speed})
    own = run.corners
    if x.corner_tolerance is None or not isinstance(own, Rounding) or own.tolerance is None:
        return run
    return replace(run, corners=replace(own, tolerance=x.corner_tolerance))


def _path(path: PathModel, x: JobOverrides) -> PathModel:
    """Replace options for reading the drawing, and its frame."""
    changes: dict[str, Any] = {
        "units": x.units,
        "scale": x.scale,
        "names": None if x.names is None else list(x.names),
        "colors": None if x.colors is None else list(x.colors),
        "flat": x.flat or None,
        "tools": x.tools,
        "unknown": SkipModel(skip=list(x.skip_words))
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
