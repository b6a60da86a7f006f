"""Tables to export: of any number of joints, with events between, on and after the points."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from armcontour import TaughtData, Trajectory
from armcontour.io.exports import Table
from armcontour.motion import TimedEvent

PERIOD = 0.004


def event(name: str, value: bool | float | str, t: float) -> TimedEvent:
    return TimedEvent(name=name, value=value, t=t, due=t + 0.01, s=0.25, point=(0.1, 0.2))


EVENTS = (
    event("tool", True, 0.0),
    event("gas", 2.5, 0.0051234567891),
    event("label", 'A, "b"; 7', 0.0051234567891),
    # On a point but for rounding.
    event("tool", False, float(np.nextafter(0.012, 0))),
    event("tool", True, 0.0455),
)


@pytest.fixture
def table() -> Callable[..., Table]:
    def make(dof: int = 6, count: int = 9, *, events: tuple[TimedEvent, ...] = EVENTS) -> Table:
        q, dq, ddq = np.random.default_rng(dof).normal(scale=2.0, size=(3, count, dof))
        return Table(
            name="part 7",
            joint_names=tuple(f"axis_{i}" for i in range(1, dof + 1)),
            period=PERIOD,
            t=np.arange(count) * PERIOD,
            q=q,
            dq=dq,
            ddq=ddq,
            events=events,
        )

    return make


@pytest.fixture
def taught(conventional: Trajectory) -> Callable[..., TaughtData]:
    def make(
        q: np.ndarray, *, start_time: float = 0.0, events: tuple[TimedEvent, ...] = EVENTS
    ) -> TaughtData:
        return TaughtData(
            period=PERIOD,
            q=q,
            trajectory=dataclasses.replace(conventional, events=events),
            method="none",
            start_time=start_time,
        )

    return make
