"""The page of a batch: results so far, and the report at the end."""

from __future__ import annotations

import numpy as np

from armcontour.batches.columns import COLUMNS
from armcontour.batches.ledger import Ledger
from armcontour.batches.parameters import Parameter
from armcontour.batches.working import DONE, STATUSES
from armcontour.report import render_batch
from armcontour.report.sections.batch import Axis, BatchView

# Scales that make numbers of a unit easy to read, and what they are called.
SHOWN = {"m": (1e3, "mm")}
# A browser loads the page of a running batch again so often [s].
REFRESH = 10


def render_page(ledger: Ledger, *, left: float | None = None, live: bool = False) -> str:
    """Render what is known of a batch as one HTML page without other files.

    Args:
        ledger: The ledger.
        left: Time left [s]; None if unknown.
        live: Whether the batch is running, so that browsers load the page again.
    """
    plan = ledger.plan
    status = ledger.status[ledger.shown()]
    axes = [
        _axis(x, ledger.parameter(k))
        for k, x in enumerate(plan.parameters)
        if len(x.values) > 1 and x.numeric
    ]
    # Figures that no job has, such as places along axes that are not varied, are left out.
    known = np.isfinite(ledger.figures).any(axis=0)
    view = BatchView(
        name=plan.name,
        about=_about(ledger),
        total=len(plan),
        counts=ledger.counts(),
        errors=ledger.errors(),
        axes=tuple(axes),
        figures=tuple(
            Axis(f"{name} [{_unit(COLUMNS[name].unit)[1]}]", _scaled(x, COLUMNS[name].unit), False)
            for name, x, some in zip(plan.columns, ledger.figures.T, known, strict=True)
            if some or not known.any()
        ),
        status=tuple("" if x < 0 else STATUSES[x] for x in status.tolist()),
        done=DONE,
        stride=ledger.stride,
        left=left,
    )
    return render_batch(view, refresh=REFRESH if live else None)


def _about(ledger: Ledger) -> str:
    """What the batch is, in a line."""
    plan = ledger.plan
    jobs = ", ".join(x.name for x in plan.bases)
    varied = ", ".join(x.key for x in plan.varied)
    return f"{len(plan)} jobs: {plan.work} {jobs}" + (f" over {varied}" if varied else "")


def _axis(x: Parameter, values: np.ndarray) -> Axis:
    """The axis of a parameter."""
    _, unit = _unit(x.unit)
    return Axis(f"{x.key} [{unit}]" if unit else x.key, _scaled(values, x.unit), x.log)


def _unit(unit: str | None) -> tuple[float, str]:
    """The scale and the name of a unit on pages."""
    return SHOWN.get(unit or "", (1.0, unit or ""))


def _scaled(values: np.ndarray, unit: str | None) -> np.ndarray:
    """Values in the unit of pages."""
    return np.asarray(values) * _unit(unit)[0]
