"""The page of a batch."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour.batches.columns import COLUMNS
from armcontour.batches.plan import Plan
from armcontour.batches.working import DONE
from armcontour.core.checks import FloatArray
from armcontour.report import render_batch
from armcontour.report.sections.batch import Axis, BatchView

# Largest number of jobs that are drawn.
MOST = 5_000


def render_page(plan: Plan, rows: Sequence[Mapping[str, Any]]) -> str:
    """Render the results of a batch as one HTML page without other files.

    Args:
        plan: The plan.
        rows: The results.
    """
    stride = max(1, -(-len(rows) // MOST))
    shown = rows[::stride]
    axes = [_axis(x.key, x.unit, shown, log=x.log) for x in plan.varied if x.numeric]
    figures = [_axis(x, COLUMNS[x].unit, shown) for x in plan.columns]
    # Figures that no job has, such as places along axes that are not varied, are left out.
    known = [x for x in figures if np.isfinite(x.values).any()]
    names = ", ".join(x.name for x in plan.bases)
    varied = ", ".join(x.key for x in plan.varied)
    view = BatchView(
        name=plan.name,
        about=f"{len(plan)} jobs: {plan.work} {names}" + (f" over {varied}" if varied else ""),
        counts=Counter(x["status"] for x in rows),
        errors=Counter(x["error"] for x in rows if x["error"]),
        axes=tuple(axes),
        figures=tuple(known or figures),
        status=tuple(x["status"] for x in shown),
        done=DONE,
        stride=stride,
    )
    return render_batch(view)


def _axis(
    name: str, unit: str | None, rows: Sequence[Mapping[str, Any]], *, log: bool = False
) -> Axis:
    """Values of a column, in SI units."""
    values: FloatArray = np.array([x[name] for x in rows], dtype=float)
    return Axis(name, unit or "", values, log)
