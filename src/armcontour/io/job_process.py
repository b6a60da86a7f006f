"""What a job file adds to its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.geometry import Demand, Path
from armcontour.io.job_arm import frame_of
from armcontour.io.job_model import EventModel, LayerModel, LeadModel, PathModel, ProcessModel
from armcontour.program import (
    Event,
    Lead,
    Process,
    Program,
    Switch,
)


def with_process(
    path: Path | Program, model: ProcessModel | None, drawing: PathModel
) -> tuple[Path | Program, Process]:
    """The path or program of a job, and its process.

    Raises:
        InvalidInput: Values that make no process.
    """
    if drawing.file is None and model is None:
        return path, Process()
    program = Program.of(path)
    if drawing.file is None:
        # The process says where a closed path of points begins, as that of a drawing.
        contours = (dataclasses.replace(x, begun=False) for x in program.contours)
        program = Program(moves=tuple(contours))
    try:
        process = _process(model or ProcessModel(), drawing, {x.layer for x in program.contours})
    except InvalidInput as error:
        raise InvalidInput(f"process: {error}") from None
    return program, process


def _process(model: ProcessModel, drawing: PathModel, there: Collection[str]) -> Process:
    frame = Frame() if drawing.frame is None else frame_of("path.frame", drawing.frame)
    layers = drawing.layers if isinstance(drawing.layers, dict) else {}
    return Process(
        begin=tuple(model.begin) if isinstance(model.begin, list) else model.begin,
        overlap=model.overlap,
        lead_in=_lead(model.lead_in),
        lead_out=_lead(model.lead_out),
        approach=model.approach,
        retract=model.retract,
        dwell=model.dwell,
        off_between=tuple(model.off_between),
        up=frame.rotation[:, 2],
        switch=None if model.switch is None else Switch(**model.switch.model_dump()),
        events=tuple(_event(x) for x in model.events),
        # Reading has told of those that the file has not.
        layers={name: _demand(x) for name, x in layers.items() if name in there},
        order=model.order,
        from_s=model.from_s,
    )


def _lead(model: LeadModel | None) -> Lead | None:
    if model is None:
        return None
    length = None if model.length == "auto" else float(model.length)
    return Lead(length=length, shape=model.shape, side=model.side)


def _event(model: EventModel) -> Event:
    values = model.model_dump(exclude={"at"})
    return dataclasses.replace(Event(**values), s=model.at)


def _demand(model: LayerModel) -> Demand:
    return Demand(speed=model.speed, tolerance=model.tolerance)
