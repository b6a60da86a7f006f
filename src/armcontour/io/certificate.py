"""Certificates as JSON and CSV, with all data that a repetition needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.arms.limits import UNITS as LIMIT_UNITS
from armcontour.certification import (
    Budget,
    Certificate,
    ContourCertificate,
    LinearFigures,
)
from armcontour.core.render import plain, units
from armcontour.io.json_text import to_json
from armcontour.jobs import Goal
from armcontour.jobs.results import run_data
from armcontour.robustness.monte_carlo import Spread

CERTIFICATE_UNITS = {
    "cost": "s",
    "t": "s",
    "work": "s",
    "t_max": "s",
    "length": "m",
    "pauses": "s",
    "shapes": "s",
    "headroom": "share of the limit",
    "lowered": "share of the speed or the limit",
    "contour": "m",
    "budget": "m",
    "tolerance": "m",
    "servo": "m",
    "rms": "m",
    "gains": "share",
    "dead_time": "s",
    "jitter": "s",
    "payload": "kg",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "friction": "share",
    "armature": "share",
    "linear": "m",
}


def certificate_json(certificate: Certificate, files: Sequence[str] = ()) -> str:
    """A certificate as JSON: requirements, results, model, and the data to repeat the plan.

    Args:
        certificate: The certificate.
        files: The files of the result, relative to its folder.
    """
    job, run = certificate.job, certificate.run
    data = run_data(certificate.result, job)
    page = {
        "armcontour": __version__,
        "job": job.name,
        "title": job.title,
        "arm": {"name": job.arm.name, "source": job.arm.source, "joints": job.arm.joint_names},
        "units": units([data]) | CERTIFICATE_UNITS,
        "certificate": _certificate(certificate),
        "runs": {run.name: plain(data)},
        "files": list(files),
    }
    return to_json(page)


def derating_csv(certificate: Certificate) -> str:
    """The derating of a certificate as CSV: a row per interval of arc length with equal derating.

    A row has the share of every joint's acceleration limit that the plan uses, and the largest
    squared speed.
    """
    names = [f"acceleration left {x} [1]" for x in certificate.job.arm.joint_names]
    lines = [",".join(["contour", "from [m]", "to [m]", *names, "largest ds^2 [m^2/s^2]"])]
    for number, contour in enumerate(certificate.contours, start=1):
        derating = contour.derating
        rows = np.column_stack([derating.share, derating.cap])
        first = np.append(True, (rows[1:] != rows[:-1]).any(axis=1))
        start = derating.cells[:-1][first]
        end = np.append(start[1:], derating.cells[-1])
        for a, b, row in zip(start, end, rows[first], strict=True):
            cells = [f"{x!r}" if np.isfinite(x) else "" for x in row.tolist()]
            lines.append(",".join([str(number), repr(float(a)), repr(float(b)), *cells]))
    return "\n".join(lines) + "\n"


def _certificate(c: Certificate) -> dict[str, Any]:
    """Data of a certificate for JSON."""
    limits, rounding = c.run.limits, c.run.rounding
    uncertified = c.uncertified
    return {
        "model": c.model,
        "on_bodies": c.on_bodies,
        "goal": _goal(c.goal),
        "run": c.run.name,
        "duration": c.duration,
        "cost": c.cost,
        "shapes": dict(c.shapes),
        "budget": _budget(c.budget),
        "headroom": {"mean": c.headroom, "largest": c.largest_headroom},
        "contours": [_contour(x) for x in c.contours],
        "uncertified": {
            "duration": uncertified.duration,
            "contour_error": {
                "max": uncertified.contour_error[0],
                "rms": uncertified.contour_error[1],
            },
            "saturated": uncertified.saturated,
            "box": uncertified.box,
        },
        "limits_used": {x.name: x.ratio for x in c.check.uses},
        "not_judged": c.check.not_judged,
        "pauses": c.pauses,
        "trials": c.trials,
        "repeat": {
            "timing": "optimal",
            "derating": "derating.csv",
            "rapids": [x.factors for x in c.rapids],
            "compensation": c.run.compensation,
            "compensation_options": dict(c.run.compensation_options),
            "period": c.run.period,
            "rounding": None if rounding is None else asdict(rounding),
            "limits": {x: getattr(limits, x) for x in LIMIT_UNITS},
            "servo": _servo(c.job.servo),
            "plant": _servo(c.job.plant_servo),
            "start": c.trajectory(0.0),
        },
    }


def _contour(x: ContourCertificate) -> dict[str, Any]:
    """Data of the certificate of one contour for JSON."""
    return {
        "name": x.name,
        "t": x.t,
        "work": x.work,
        "duration": x.duration,
        "optimum": x.optimum,
        "length": x.path.length,
        "shape": x.shape,
        "contour_error": {"max": x.error.max, "rms": x.error.rms, "t_max": x.error.t_max},
        "missed": asdict(x.missed),
        "speed_ratio": x.speed_ratio,
        "budget": _budget(x.budget),
        "headroom": {"mean": x.headroom, "largest": x.largest_headroom, "others": x.factors},
        "corners": None if x.corners is None else _spread(x.corners),
        "spread": None if x.spread is None else _spread(x.spread),
        "lowered": [asdict(y) for y in x.lowered],
        "linear": None if x.linear is None else _linear(x.linear, x.budget.servo_allowed),
        "trials": x.trials,
    }


def _budget(x: Budget) -> dict[str, Any]:
    return asdict(x) | {"executed": x.executed, "total": x.total, "left": x.left}


def _goal(goal: Goal) -> dict[str, Any]:
    """Data of the requirements for JSON."""
    box = goal.box
    return {
        **{x: getattr(goal, x) for x in Goal.__dataclass_fields__ if x != "box"},
        "box": None if box is None else {x: getattr(box, x) for x in box.__dataclass_fields__},
    }


def _servo(servo: Any) -> dict[str, Any]:
    return {x: getattr(servo, x) for x in type(servo).__dataclass_fields__}


def _spread(x: Spread) -> dict[str, Any]:
    """Data of executions of robots in a box for JSON."""
    return {
        "executions": len(x),
        "seed": x.seed,
        "max": float(x.max.max()),
        "rms": float(x.rms.max()),
        "saturated": float(x.saturated.max()),
        "worst": x.worst_deviations,
        "nominal": {"max": x.nominal_max, "rms": x.nominal_rms},
    }


def _linear(x: LinearFigures, budget: float) -> dict[str, Any]:
    """Data of the linear model of rigid bodies for JSON; `budget` is the largest allowed error."""
    return {
        "nominal": x.nominal,
        "bound": x.bound,
        "corner": x.corner,
        "shares": dict(x.shares),
        "drawn": {
            "robots": len(x.drawn),
            "seed": x.seed,
            "max": float(x.drawn.max()),
            "within": x.within(budget),
        },
    }
