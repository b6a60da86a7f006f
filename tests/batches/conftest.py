"""A small job and plans over it."""

import pytest

JOB = """\
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.33, 0.20], [0.33, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 10 ms
runs: {only: {compensation: {method: none}}}
"""


@pytest.fixture(scope="session")
def jobs(tmp_path_factory):
    """A folder with the small job."""
    folder = tmp_path_factory.mktemp("jobs")
    (folder / "bend.yaml").write_text(JOB)
    return folder


@pytest.fixture
def planned(jobs):
    """A plan over the small job, as data."""

    def plan(over=None, **more):
        return {"job": str(jobs / "bend.yaml"), "over": over or {}, **more}

    return plan
