"""Many random problems, each judged by code that shares nothing with the package."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The result of one seed's problem.

    Args:
        kind: Sort of the problem.
        result: What the package did, such as "planned" or "refused".
        notes: What is wrong; empty if nothing is.
        worst: Largest ratio to a limit.
        covered: Whether each interval, by its name, holds the true value.
    """

    kind: str = ""
    result: str = ""
    notes: list[str] = field(default_factory=list)
    worst: float = 0.0
    covered: dict[str, bool] = field(default_factory=dict)
