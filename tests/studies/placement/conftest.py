"""A small job on an arm in space, and one in the plane."""

from dataclasses import replace

import pytest

from armcontour.files import parse_job

SQUARE = """
name: square
arm: ur5e
path:
  points: [[0.5, 0.0, 0.2], [0.56, 0.0, 0.2], [0.56, 0.06, 0.2], [0.5, 0.0, 0.2]]
  orientation: {quaternion: [1, 0, 0, 0]}
limits: {speed: 0.25 m/s}
corners: {tolerance: 0.25 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {compensation: {method: inverse}}}
"""
PLANE = """
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: pole_placement}}}
"""


@pytest.fixture(scope="session")
def square():
    """Without shapes of the links, so that nothing but limits refuses a place."""
    job = parse_job(SQUARE)
    return replace(job, arm=job.arm.with_shapes(None))


@pytest.fixture(scope="session")
def plane():
    return parse_job(PLANE)
