"""Tables to export, with any number of joints and events at and between points."""

import dataclasses

import numpy as np
import pytest

from armcontour import SetPoints
from armcontour.files.exports import SetPointTable
from armcontour.motion import TimedEvent

CYCLE = 0.004


def event(name, value, t):
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
def table():
    def make(dof=6, count=9, *, events=EVENTS):
        arrays = np.random.default_rng(dof).normal(scale=2.0, size=(3, count, dof))
        names = tuple(f"axis_{i}" for i in range(1, dof + 1))
        arrays = dict(zip(("q", "dq", "ddq"), arrays, strict=True), t=np.arange(count) * CYCLE)
        return SetPointTable(name="part 7", joint_names=names, cycle=CYCLE, events=events, **arrays)

    return make


@pytest.fixture
def set_points(conventional):
    def make(q, *, start_time=0.0, events=EVENTS):
        plan = dataclasses.replace(conventional, events=events)
        metadata = {"cycle": CYCLE, "method": "none", "start_time": start_time}
        return SetPoints(q=q, trajectory=plan, **metadata)

    return make
