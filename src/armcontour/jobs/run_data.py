"""Rows and tables of a run: torques, plant, corners and moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.fields import quantities
from armcontour.core.render import number, plain
from armcontour.core.result import VERDICT, Row, Table
from armcontour.core.text import count_noun, list_some
from armcontour.geometry import RoundedPath, ShapedPath
from armcontour.jobs.plan_quantities import Torques, angular_speed, assumed_numbers
from armcontour.motion import Execution, Span, Trajectory
from armcontour.program import Contour, Program
from armcontour.program.preparation import PIERCE
from armcontour.robot import Arm
from armcontour.robot.chain import Chain
from armcontour.simulation import RigidBodyPlant
from armcontour.verification import ErrorProfile


def warning_rows(warnings: Sequence[str]) -> Iterator[Row]:
    """Yield rows with the number of warnings and with the warnings."""
    if warnings:
        yield Row("warning_count", len(warnings), "", "warnings", level=VERDICT)
    yield Row("warnings", warnings)


def field_rows(name: str, value: Any) -> Iterator[Row]:
    """Yield one file-only row per field of a dataclass, with the unit of its annotation."""
    if value is None:
        yield Row(name, None)
        return
    kind: Any = type(value)
    units = quantities(kind)
    for attribute in fields(value):
        inner, key = getattr(value, attribute.name), f"{name}.{attribute.name}"
        if is_dataclass(inner):
            yield from field_rows(key, inner)
            continue
        yield Row(key, inner, units[attribute.name].unit if attribute.name in units else "")


def torque_rows(
    torques: Torques | None, limit: FloatArray | None, arm: Arm, kind: str
) -> Iterator[Row]:
    """Yield rows of the largest torques, their limits, and assumed mass parameters."""
    if torques is None:
        return
    peak = torques.peak
    yield Row("torque.peak", peak, "N m")
    yield Row("torque.limit", limit, "N m")
    yield Row("torque.assumed", assumed_numbers(arm) or None)
    if limit is None:
        yield Row("torque_ratio", None)
        return
    share = peak / limit
    worst = int(share.argmax())
    joint = arm.joint_names[worst]
    note = f"{joint}, {number(peak[worst], 'N m')} of {number(limit[worst], 'N m')}"
    yield Row("torque_ratio", share, "1", f"drive torque, {kind}", note)


def plant_rows(plant: RigidBodyPlant) -> Iterator[Row]:
    """Yield rows of parameters of the simulated robot and of the model in its controller."""
    yield Row("plant", type(plant).__name__)
    yield Row("step", plant.step, "s")
    yield Row("gravity_feedforward", plant.gravity_feedforward)
    yield Row("nominal_inertia", plant.nominal_inertia, "kg m^2")
    yield from _robot("robot", plant.chain)
    yield from _robot("controller", plant.controller_chain)


def _robot(name: str, chain: Chain) -> Iterator[Row]:
    """Yield rows of payload, drive inertias and friction of a chain."""
    yield Row(f"{name}.payload", 0.0 if chain.payload is None else chain.payload.mass, "kg")
    yield Row(f"{name}.armature", chain.armature, "kg m^2")
    yield Row(f"{name}.viscous", chain.viscous, "N m s/rad")
    yield Row(f"{name}.coulomb", chain.coulomb, "N m")


def angular_rows(execution: Execution) -> Iterator[Row]:
    """Yield the row of the largest angular speed of the tool; nothing for a planar arm."""
    speed = angular_speed(execution)
    if speed is not None:
        yield Row("angular_speed", speed.max(), "rad/s", "tool's angular speed, largest")


def columns(**units: str) -> tuple[Row, ...]:
    """Columns of a table for files, from the unit of each column by name."""
    return tuple(Row(name, None, unit) for name, unit in units.items())


def corner_table(path: RoundedPath) -> Table:
    """Table of the rounded corners of a path."""
    c = path.corners
    return Table(
        "corners",
        columns(
            **{"joint": "", "point": "m", "turn": "rad", "radius": "m", "error": "m"},
            **{"angular_error": "rad", "tangent": "m", "shrunk": "", "full_stop": ""},
            **{"reason": "", "speed": "m/s"},
        ),
        list(
            zip(
                *(c.vertex, c.point, c.turn, c.radius, c.error, c.angular_error, c.tangent),
                *(c.shrunk, c.stopped, c.reason, c.speed),
                strict=True,
            )
        ),
    )


def move_table(
    trajectory: Trajectory,
    path: Program,
    starts: Sequence[tuple[float, float]],
    errors: Sequence[ErrorProfile],
) -> Table:
    """Table of the moves of a program with times; only rows of contours have all values."""
    contours = iter(zip(path.contours, starts, strict=True))
    remaining = iter(errors)
    rows = []
    for span in trajectory.spans:
        profile: tuple[Any, ...] = (None,) * 7
        if span.kind == "contour":
            contour, resume_at = next(contours)
            error = next(remaining, None)
            geometry = contour.path
            profile = (
                *(contour.name, contour.layer, contour.closed, span.work, resume_at),
                _outcome(geometry) if isinstance(geometry, ShapedPath) else None,
                None if error is None else plain(error.to_data()),
            )
        rows.append((span.kind, span.t, span.s, *profile))
    return Table(
        "moves",
        columns(
            **{"kind": "", "t": "s", "s": "m", "name": "", "layer": "", "closed": ""},
            **{"work": "s", "resume_at": "m", "shaping": "", "contour_error": "m"},
        ),
        rows,
    )


def work_length(contour: Contour) -> float:
    """Length of a contour with the process on [m]."""
    start, end = contour.at_work
    return end - start


def pierce_length(contour: Contour) -> float:
    """Length of the move from the pierce height to the lead-in or the contour [m]."""
    tags = contour.path.tags
    return float(sum(contour.path.lengths[k] for k, tag in enumerate(tags) if tag == PIERCE))


def program_rows(trajectory: Trajectory, path: Program, objective: Program) -> Iterator[Row]:
    """Yield rows of lengths and times of a program, with the process on and off."""
    spans = trajectory.spans
    works = [x.work for x in trajectory.contour_spans if x.work is not None]
    rapids, dwells = ([x for x in spans if x.kind == kind] for kind in ("rapid", "dwell"))
    length, time = sum(map(work_length, path.contours)), sum(end - start for start, end in works)
    pierces = sum(map(pierce_length, path.contours))
    leads = path.length - length - pierces
    closed = sum(x.closed for x in objective.contours)
    layers = count_noun(len({x.layer for x in path.contours}), "layer")
    ways = {"leads": leads if leads > 1e-9 else 0.0, "pierces": pierces}
    note = ", ".join(f"{name} {number(x, 'm')}" for name, x in ways.items() if x)
    mean = f"mean {number(length / time, 'm/s')}" if time else ""
    dwelling = f"dwells {number(_duration(dwells), 's')}" if dwells else ""
    names = list_some(list(dict.fromkeys(x.name for x in trajectory.events)), 4)
    yield Row("contours", len(path.contours), "", "contours", f"{closed} closed, {layers}")
    yield Row("work_length", length, "m", "length at work", note or "no leads")
    yield Row("work_time", time, "s", "time at work", mean)
    yield Row("rapid_time", _duration(rapids), "s", "time of rapids", dwelling)
    yield Row("event_count", len(trajectory.events), "", "events", names)


def _duration(spans: Sequence[Span]) -> float:
    """Total duration of spans [s]."""
    return float(sum(x.t[1] - x.t[0] for x in spans))


def _outcome(path: ShapedPath) -> dict[str, Any]:
    """Outcome of the shape search of a contour, by name."""
    outcome = path.outcome
    data = {x: getattr(outcome, x) for x in ("start", "durations", "gain")}
    return data | {"iterations": max(len(outcome.history) - 1, 0)}


def resume_intervals(begin: float, objective: Program) -> list[tuple[float, float]]:
    """Start and end of every contour as values of `resume_at`: cumulated working length [m]."""
    lengths = [end - start for start, end in (x.at_work for x in objective.contours)]
    ends = begin + np.concatenate([[0.0], np.cumsum(lengths)])
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
