"""The methods that a job can name: a class of options for each timing and each compensation."""

from __future__ import annotations

from armcontour.control.compensation import (
    CompensationOptions,
    Inverse,
    InverseDynamics,
    NoCompensation,
)
from armcontour.paper import Conventional, Paper, PolePlacement
from armcontour.planning import Optimal, PlanOptions

# Timing methods that do not change the path, by name.
TIMINGS: dict[str, type[PlanOptions]] = {x.method.value: x for x in (Optimal, Paper, Conventional)}
# Compensations by name.
COMPENSATIONS: dict[str, type[CompensationOptions]] = {
    x.method: x for x in (Inverse, PolePlacement, InverseDynamics, NoCompensation)
}
