"""Plans of certificates, which the pages show and export."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.text import show
from armcontour.jobs.run_result import RunResult
from armcontour.report.message_frame import MessageFrame

# Maximum number of certificates whose plans are kept. A plan can have hundreds of megabytes.
MAX_PLANS = 3


@dataclass(frozen=True, slots=True)
class CertifiedPlan:
    """The plan that a certificate proves.

    Args:
        id: Identifier of the task that made the certificate.
        data: The pickled `RunResult`.
        figures: Header of the frame `figures` of the plan.
    """

    id: str
    data: bytes
    figures: Mapping[str, Any]

    @property
    def run(self) -> str:
        """Name of the run."""
        return str(self.figures["run"])

    def load(self) -> RunResult:
        """Return the plan with its set-points and their execution."""
        plan = pickle.loads(self.data)
        assert isinstance(plan, RunResult)
        return plan


class CertifiedPlans:
    """Plans of the newest certificates, by identifier of the task."""

    def __init__(self) -> None:
        self._plans: dict[str, CertifiedPlan] = {}

    def take(self, frame: MessageFrame) -> MessageFrame:
        """Keep the plan of a result, if it has one; returns the frame without the plan.

        The header says in `has_plan` whether the result has a plan.
        """
        arrays = dict(frame.arrays)
        header = dict(frame.header)
        plan = arrays.pop("plan", None)
        if plan is not None:
            id = str(header["id"])
            figures = MessageFrame.unpack(arrays.pop("figures").tobytes())
            self._plans[id] = CertifiedPlan(id, plan.tobytes(), figures.header)
            header["has_plan"] = True
            while len(self._plans) > MAX_PLANS:
                del self._plans[next(iter(self._plans))]
        return MessageFrame(frame.kind, header, arrays)

    def find(self, id: Any) -> CertifiedPlan:
        """Return the plan of a certificate.

        Raises:
            InvalidInput: There is no certificate with this identifier, or its plan is not kept.
        """
        plan = self._plans.get(id) if isinstance(id, str) else None
        if plan is None:
            raise InvalidInput(
                f"The plan of the certificate {show(id)} is not kept: only those of the last "
                f"{MAX_PLANS} certificates are. Certify again."
            )
        return plan

    def clear(self) -> None:
        """Forget all plans, because another document is opened."""
        self._plans.clear()
