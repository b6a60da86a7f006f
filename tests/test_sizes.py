"""Work on too many values is refused before they are computed, and numbers out of range."""

import dataclasses

import numpy as np
import pytest
import yaml
from tests.properties.number_cases import PLANE, put

import armcontour as ac
from armcontour.io import parse_job
from armcontour.io.cell import read_cell
from armcontour.jobs import Experiment, teach


def job(**changes):
    """The small job in the plane, with values at keys with dots."""
    data = PLANE
    for place, value in changes.items():
        data = put(data, tuple(place.split("__")), value)
    return parse_job(yaml.safe_dump(data))


def teach_with_a_dwell_of_a_day(folder):
    file = folder / "part.ngc"
    file.write_text("G21 G90 G17\nG0 X10 Y10\nF600\nG1 X20 Y10\nG4 P99999\nG1 X20 Y20\nM2\n")
    job = read_cell("pmk3s", file)
    runs = tuple(dataclasses.replace(x, period=1e-3) for x in job.runs)
    teach(dataclasses.replace(job, runs=runs))


def test_large_motions_are_refused(tmp_path):
    for call in (
        lambda: teach(job(limits__speed=1e-6, command_interval=1e-3)),
        lambda: teach_with_a_dwell_of_a_day(tmp_path),
    ):
        with pytest.raises(ac.InvalidInput, match="longer command interval") as caught:
            call()
        assert caught.value.needed > caught.value.allowed == 5e7
    with pytest.raises(ac.InvalidInput, match=r"Run one: At its assigned velocities.*raise speed"):
        job(limits__speed=1e-12)


def test_numbers_out_of_range_are_refused():
    for interval in (1e9, 5e-324, 2e-7):
        with pytest.raises(ac.InvalidInput, match="command interval must be from 1e-06 to 10 s"):
            job(command_interval=interval)
    for step in (1e-12, 1e-300, 5e-324, 1e-9, 1e9):
        with pytest.raises(ac.InvalidInput, match="drives must be from 1e-06 to 0.1 s"):
            Experiment(step=step)
    with pytest.raises(ac.InvalidInput, match=r"between -1e\+12 and 1e\+12 m, but is 1e\+300"):
        ac.Path.polyline([[1e300, 0.0], [0.0, 0.0]])
    with pytest.raises(ac.InvalidInput, match="speed must be at least 1e-30 m/s"):
        ac.Limits(speed=5e-324)
    with pytest.raises(ac.InvalidInput, match=r"joint_lower must be between"):
        ac.Limits(joint_lower=np.array([-1e300]))


def test_compensation_and_execution_have_their_own_bounds():
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.1)
    path = ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]])
    plan = ac.plan(path, arm, limits.replace(speed=1e-3), intervals=50)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plant, taught = ac.ServoPlant(arm, servo), ac.compensate(plan, servo)
    for call, words in (
        (
            lambda: ac.compensate(plan, servo, period=1e-6),
            "command interval of 1e-06 s would",
        ),
        (lambda: ac.execute(taught, plant, resolution=1e-9), "The simulation of .* every 1e-09 s"),
        (
            lambda: ac.plan(path, arm, limits, intervals=10**7),
            "intervals must be",
        ),
        (
            lambda: ac.compensate(plan, servo, method="pole_placement", poles=[-1e6, -1e6, -150.0]),
            "pole of 1e",
        ),
    ):
        with pytest.raises(ac.InvalidInput, match=words):
            call()
