"""Travel of axes with weights from 0.01 to 1000, and the durations of what is preferred."""

import numpy as np
import pytest
from tests.planning import cells

import armcontour as ac
from armcontour.robot import JointPreference

WEIGHTS = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)
# Travel may grow with the weight by this share of the largest travel.
MONOTONE = 0.05
# Share of the travel with the smallest weight that a slide may have with the largest one.
HEAVY = 0.5
SLIDES = ("rail", "gx", "gy")
CIRCLE = (2.5, 1.5, 0.8)
ENDS = (1.5, 1.5, 0.8), (4.5, 1.5, 0.8)
# Cells: the path, its speed [m/s], and the axis with the weight.
CELLS = {
    "rail, seam": ("rail", cells.seam, 0.02, ("rail",)),
    "rail, short seam": ("rail", lambda: cells.seam(0.6, 1.2), 0.02, ("rail",)),
    "rail, zigzag": ("rail", cells.zigzag, 1.0, ("rail",)),
    "positioner, turn": ("positioner", cells.saddle, 0.006, ("turn",)),
    "positioner, rail": ("positioner", cells.saddle, 0.006, ("rail",)),
    "positioner without tilt": ("level", cells.saddle, 0.006, ("turn", "tilt")),
    "gantry, circle": ("gantry", lambda: cells.circle(*CIRCLE), 0.06, ("gx", "gy")),
    "gantry, line": ("gantry", lambda: ac.Path.polyline(ENDS).pointing(cells.DOWN), 0.06, ("gx",)),
    "described table": ("table", lambda: cells.circle(0.0, 0.1, 0.15, 0.1), 0.02, ("turn",)),
}


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    folders = [tmp_path_factory.mktemp(x) for x in ("gantry", "table")]
    return {
        "rail": cells.on_rail(),
        "positioner": cells.on_positioner(),
        "level": cells.on_positioner(tilt=None),
        "gantry": cells.from_description(folders[0], gantry=True, table=False),
        "table": cells.from_description(folders[1], gantry=False, table=True),
    }


def planned(arm, path, speed, axes, weight, prefer=None):
    """Plan with a weight; return the duration [s] and the travel of the axes."""
    preferences = {x: JointPreference(weight=weight) for x in axes}
    arm = arm.with_preferences(preferences, prefer=prefer)
    motion = ac.plan(path, arm, arm.limits.replace(speed=speed))
    q = motion(np.linspace(0.0, motion.duration, 3000))
    travel = np.abs(np.diff(q, axis=0)).sum(axis=0)
    return motion.duration, sum(travel[arm.joint_names.index(x)] for x in axes)


@pytest.mark.parametrize("name", CELLS)
def test_heavier_axes_travel_less(arms, name):
    kind, make, speed, axes = CELLS[name]
    path = make()
    travels = [planned(arms[kind], path, speed, axes, x)[1] for x in WEIGHTS]
    print(name, *(f"{x:g}: {y:.3f}" for x, y in zip(WEIGHTS, travels, strict=True)))
    assert (np.diff(travels) <= MONOTONE * travels[0]).all()
    if set(axes) <= set(SLIDES):
        assert travels[-1] <= HEAVY * travels[0]


@pytest.mark.parametrize("name", CELLS)
def test_fastest_is_never_slower(arms, name):
    kind, make, speed, axes = CELLS[name]
    path = make()
    durations = {}
    for prefer in (None, "fastest", "least motion"):
        durations[prefer] = planned(arms[kind], path, speed, axes, 1.0, prefer)[0]
    print(name, durations)
    assert durations["fastest"] <= min(durations.values()) * (1 + 1e-6)
