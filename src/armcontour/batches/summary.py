"""The plan of a batch, and the summary of its results, as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from armcontour._version import __version__
from armcontour.batches.ledger import UNREPRODUCIBLE, Ledger
from armcontour.batches.plan import Plan
from armcontour.io.json_text import to_json


class Extremes:
    """Least and largest figures of all jobs, and of which jobs they are.

    Args:
        plan: The plan.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._found: dict[str, dict[str, tuple[float, int]]] = {x: {} for x in plan.columns}

    def add(self, rows: Mapping[str, Sequence[Any]]) -> None:
        """Take some rows of results."""
        for name, found in self._found.items():
            known = [
                (x, n) for x, n in zip(rows[name], rows["number"], strict=True) if x is not None
            ]
            if known:
                low, high = min(known), max(known, key=lambda x: (x[0], -x[1]))
                found["least"] = min(found.get("least", low), low)
                found["largest"] = max(
                    found.get("largest", high), high, key=lambda x: (x[0], -x[1])
                )

    def data(self) -> dict[str, Any]:
        """By the names of the columns: least and largest figure with the job of each."""
        return {
            name: {x: self._of(*found[x]) for x in ("least", "largest") if x in found}
            for name, found in self._found.items()
        }

    def _of(self, value: float, number: int) -> dict[str, Any]:
        """A figure, and the job that has it."""
        values = self._plan.values(number - 1)
        keys = [x.key for x in self._plan.parameters]
        job = self._plan.bases[self._plan.base(number - 1)].name
        return {
            "value": value,
            "number": number,
            "job": job,
            **dict(zip(keys, values, strict=True)),
        }


def plan_json(plan: Plan) -> str:
    """A plan as JSON, for people and programs that look into its folder."""
    return to_json(_about(plan))


def summary_json(ledger: Ledger, extremes: Extremes) -> str:
    """The results of a batch in short, as JSON.

    Args:
        ledger: The ledger with all results.
        extremes: Least and largest figures.
    """
    data = {
        **_about(ledger.plan),
        "statuses": ledger.counts(),
        "errors": ledger.errors(),
        "figures": extremes.data(),
        "not_reproducible": UNREPRODUCIBLE,
    }
    return to_json(data)


def _about(plan: Plan) -> dict[str, Any]:
    """Data of a plan."""
    return {
        "armcontour": __version__,
        "batch": plan.name,
        "do": plan.work,
        "jobs": [{"name": x.name, "source": x.source, "run": x.run} for x in plan.bases],
        "count": len(plan),
        "combine": plan.combine if plan.samples is None else f"{len(plan.samples)} samples",
        "parameters": {
            x.key: {
                "values": len(plan.samples)
                if x.sampled and plan.samples is not None
                else len(x.values),
                "from": x.values[0],
                "to": x.values[-1],
                "scale": "log" if x.log else "linear",
            }
            for x in plan.parameters
        },
        "columns": plan.columns,
        "units": plan.units,
    }
