"""Memory is estimated before it is taken, and bounded."""

import dataclasses

import numpy as np
import pytest
import yaml
from soak.number_cases import PLANE, put

import armcontour as ac
from armcontour import _memory
from armcontour.io import parse_job
from armcontour.io.cell import read_cell
from armcontour.jobs import Experiment, run, teach
from armcontour.jobs.memory import needed_bytes


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


def test_large_motions_are_refused_before_they_are_planned(tmp_path, monkeypatch):
    def never(*_, **__):
        raise AssertionError("it was planned")

    slow = {"limits__speed": 1e-6, "command_interval": 1e-3}
    medium = slow | {"limits__speed": 1e-4, "memory": "0.5 GB"}
    with monkeypatch.context() as patched:
        patched.setattr("armcontour.jobs.programs.plan", never)
        patched.setattr("armcontour.jobs.programs.trace_and_plan", never)
        for call, words in (
            (lambda: teach(job(**slow)), r"set-points,? .*GB of memory.*longer command int"),
            (lambda: run(job(**slow)), r"and their simulation, .*--no-simulation.*--memory"),
            (lambda: teach(job(**medium)), "At least .* s of motion.*the bound of 0.5 GB"),
        ):
            with pytest.raises(ac.InvalidInput, match=words) as caught:
                call()
    assert caught.value.limit == "memory" and caught.value.allowed == 0.5e9
    assert 0.5e9 < caught.value.needed < 2e9
    with pytest.raises(ac.InvalidInput, match="GB of memory"):
        teach_with_a_dwell_of_a_day(tmp_path)
    with pytest.raises(ac.InvalidInput, match=r"Run one: At its assigned velocities.*raise speed"):
        job(limits__speed=1e-12)


def test_bounds_and_their_default():
    assert job(memory="4 GB").memory == 4e9
    with pytest.raises(ac.InvalidInput, match="memory must be from 5e"):
        job(memory=1.0)
    whole = _memory.machine_memory()
    assert job().memory == _memory.DEFAULT == max(2e9, 0.5 * (whole or 0.0))
    # Job files of all machines have the same schema.
    assert job(memory=None).memory == _memory.DEFAULT


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


def test_a_plan_takes_memory_before_its_set_points_do(tmp_path):
    """Of both the larger counts; viscous friction under limits of torque makes plans larger."""
    file = tmp_path / "part.ngc"
    lines = "".join(f"G1 X{10 + k * 0.5} Y{10 + k % 2}\n" for k in range(1, 60))
    file.write_text(f"G21 G90 G17 G64 P0.05\nG0 X10 Y10\nF6000\n{lines}M2\n")
    smooth = read_cell("ur5e", file)
    viscous = dataclasses.replace(smooth, arm=smooth.arm.with_dynamics(viscous=[1.0] * 6))

    def needed(job, duration):
        return needed_bytes(job, job.runs[0], duration, False)

    assert needed(smooth, 0.01) == needed(smooth, 0.02) < 0.6 * needed(viscous, 0.01)
    assert needed(smooth, 0.02) < needed(smooth, 100.0) == needed(viscous, 100.0)


def test_compensation_and_execution_have_their_own_bounds():
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.1)
    path = ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]])
    plan = ac.plan(path, arm, limits, intervals=50)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    plant, taught = ac.ServoPlant(arm, servo), ac.compensate(plan, servo)
    for call, words in (
        (
            lambda: ac.compensate(plan, servo, period=1e-6, memory=0.5e9),
            r"command interval of 1e-06 s, .* set-points, would",
        ),
        (lambda: ac.execute(taught, plant, resolution=1e-9), "The simulation of .* every 1e-09 s"),
        (
            lambda: ac.plan(path, arm, limits, intervals=10**7),
            r"plan of 1e\+07 intervals would take about 14.8 GB",
        ),
        (
            lambda: ac.compensate(plan, servo, method="pole_placement", poles=[-1e6, -1e6, -150.0]),
            "pole of 1e",
        ),
    ):
        with pytest.raises(ac.InvalidInput, match=words):
            call()
