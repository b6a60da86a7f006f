"""The tool above the part, for a first run: every move by one vector along the part's z axis."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.files import parse_job

# A part that is tilted by 20 degrees about x: its z axis is not vertical.
TILT = np.radians(20)
JOB = """
name: tilted
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  points: [[0, 0, 0], [40 mm, 0, 0], [40 mm, 30 mm, 0]]
  frame: {position: [400 mm, -80 mm, 100 mm], rpy: [20 deg, 0, 0]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 60 mm/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
process: {approach: 10 mm, retract: 10 mm, switch: {name: torch}}
runs: {one: {}}
"""
LIFTED = JOB.replace("process: {", "process: {off: true, lift: 20 mm, ")


def run_of(text):
    return ac.run(parse_job(text)).runs["one"]


def test_tool_moves_above_the_part_along_its_z_axis():
    on_part = run_of(JOB.replace("process: {", "process: {off: true, "))
    above = run_of(LIFTED)
    normal = np.array([0.0, -np.sin(TILT), np.cos(TILT)])
    for low, high in zip(on_part.path.moves, above.path.moves, strict=True):
        if getattr(low, "path", None) is not None:
            s = np.linspace(0, low.path.length, 50)
            np.testing.assert_allclose(high.path(s) - low.path(s), np.tile(20e-3 * normal, (50, 1)))
    # The executed tool is there as well, and the run is judged against the lifted path.
    heights = (above.execution.tool - on_part.path.contours[0].path(0.0)) @ normal
    assert heights.min() > 19.9e-3
    assert above.kept is True


def test_lift_needs_a_process_that_is_off():
    with pytest.raises(ac.InvalidInput, match="--process-off") as caught:
        parse_job(JOB.replace("process: {", "process: {lift: 20 mm, "))
    assert caught.value.key[0] == "process"
    assert {("off",): True} in caught.value.remedies


def test_planar_arm_has_no_lift():
    text = """
name: plane
arm: pmk3s
path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]}
limits: {speed: 0.10 m/s}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
process: {off: true, lift: 20 mm}
runs: {one: {}}
"""
    with pytest.raises(ac.InvalidInput, match="lift"):
        ac.run(parse_job(text))


OBSTACLE = """scene:
  obstacles: [{type: box, name: roof, size: [300 mm, 300 mm, 20 mm], at: [0.42, -0.07, HEIGHT]}]
"""


@needs_dynamics
def test_clearance_is_checked_above_the_part():
    # A roof over the part, with room for the tool on the part but not above it.
    roof = OBSTACLE.replace("HEIGHT", "0.485")
    flat = LIFTED.replace("rpy: [20 deg, 0, 0]", "rpy: [0, 0, 0]")
    assert run_of(flat.replace("lift: 20 mm", "lift: 0") + roof).clearance.satisfied
    with pytest.raises(ac.Collision, match="roof"):
        run_of(flat.replace("lift: 20 mm", "lift: 60 mm") + roof)


def test_resumed_place_is_the_same_with_a_lift():
    resumed = LIFTED.replace("lift: 20 mm", "lift: 20 mm, resume_at: 30 mm")
    whole = run_of(LIFTED).path.contours[0].path
    rest = run_of(resumed).path.contours[0].path
    np.testing.assert_allclose(rest(0.0), whole(30e-3), atol=1e-9)
