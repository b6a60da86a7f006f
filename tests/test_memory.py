"""Memory is estimated before it is taken, and bounded."""

from __future__ import annotations

import dataclasses
import time

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


def job(**changes: object) -> ac.Job:
    """The small job in the plane, with values at places with dots."""
    data = PLANE
    for place, value in changes.items():
        data = put(data, tuple(place.split("__")), value)
    return parse_job(yaml.safe_dump(data))


def test_a_slow_motion_is_refused_before_it_is_planned() -> None:
    begin = time.process_time()
    with pytest.raises(ac.InvalidInput, match=r"set-points,? .*GB of memory.*longer command int"):
        teach(job(limits__speed=1e-6, command_interval=1e-3))
    with pytest.raises(ac.InvalidInput, match=r"and their simulation, .*--no-simulation.*--memory"):
        run(job(limits__speed=1e-6, command_interval=1e-3))
    assert time.process_time() - begin < 2.0


def test_an_estimate_before_planning_is_stated_as_a_lower_bound() -> None:
    with pytest.raises(ac.InvalidInput, match=r"At least .* s of motion") as caught:
        teach(job(limits__speed=1e-4, command_interval=1e-3, memory="0.5 GB"))
    assert caught.value.limit == "memory"


def test_a_speed_at_which_the_path_takes_for_ever_is_refused() -> None:
    with pytest.raises(ac.InvalidInput, match=r"Run one: At its assigned velocities.*raise speed"):
        job(limits__speed=1e-12)


@pytest.mark.parametrize("interval", [1e9, 5e-324, 2e-7])
def test_command_intervals_of_no_controller_are_refused(interval: float) -> None:
    with pytest.raises(ac.InvalidInput, match="command interval must be from 1e-06 to 10 s"):
        job(command_interval=interval)


@pytest.mark.parametrize("step", [1e-12, 1e-300, 5e-324, 1e-9, 1e9])
def test_steps_of_no_drive_are_refused(step: float) -> None:
    with pytest.raises(ac.InvalidInput, match="drives must be from 1e-06 to 0.1 s"):
        Experiment(step=step)


def test_a_bound_can_be_raised_and_lowered() -> None:
    small = {"limits__speed": 1e-4, "command_interval": 1e-3}
    with pytest.raises(ac.InvalidInput, match="more than the bound of 0.5 GB") as caught:
        teach(job(memory="0.5 GB", **small))
    assert caught.value.allowed == 0.5e9
    assert 0.5e9 < caught.value.needed < 2e9
    assert job(memory="4 GB").memory == 4e9
    with pytest.raises(ac.InvalidInput, match="memory must be from 5e"):
        job(memory=1.0)


def test_a_plan_takes_memory_before_its_set_points_do(tmp_path) -> None:
    """Of both the larger counts; viscous friction under limits of torque makes plans larger."""
    file = tmp_path / "part.ngc"
    lines = "".join(f"G1 X{10 + k * 0.5} Y{10 + k % 2}\n" for k in range(1, 60))
    file.write_text(f"G21 G90 G17 G64 P0.05\nG0 X10 Y10\nF6000\n{lines}M2\n")
    smooth = read_cell("ur5e", file)
    viscous = dataclasses.replace(smooth, arm=smooth.arm.with_dynamics(viscous=[1.0] * 6))

    def needed(job: ac.Job, duration: float) -> float:
        return needed_bytes(job, job.runs[0], duration, False)

    assert needed(smooth, 0.01) == needed(smooth, 0.02) < 0.6 * needed(viscous, 0.01)
    assert needed(smooth, 0.02) < needed(smooth, 100.0) == needed(viscous, 100.0)


def test_compensation_and_execution_have_their_own_bounds() -> None:
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.1)
    path = ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]])
    plan = ac.plan(path, arm, limits, intervals=50)
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    with pytest.raises(ac.InvalidInput, match=r"command interval of 1e-06 s, .* set-points, would"):
        ac.compensate(plan, servo, period=1e-6, memory=0.5e9)
    taught = ac.compensate(plan, servo)
    with pytest.raises(ac.InvalidInput, match="The simulation of .* results every 1e-09 s"):
        ac.execute(taught, ac.ServoPlant(arm, servo), resolution=1e-9)
    with pytest.raises(ac.InvalidInput, match=r"plan of 1e\+07 intervals would take about 14.8 GB"):
        ac.plan(path, arm, limits, intervals=10**7)
    with pytest.raises(ac.InvalidInput, match="pole of 1e"):
        ac.compensate(plan, servo, poles=[-1e6, -1e6, -150.0])


def test_a_dwell_of_a_day_is_refused_soon(tmp_path) -> None:
    file = tmp_path / "part.ngc"
    file.write_text("G21 G90 G17\nG0 X10 Y10\nF600\nG1 X20 Y10\nG4 P99999\nG1 X20 Y20\nM2\n")
    with pytest.raises(ac.InvalidInput, match="GB of memory"):
        job = read_cell("pmk3s", file)
        runs = tuple(dataclasses.replace(x, period=1e-3) for x in job.runs)
        teach(dataclasses.replace(job, runs=runs))


def test_large_numbers_are_refused_where_they_are_born() -> None:
    with pytest.raises(ac.InvalidInput, match=r"between -1e\+12 and 1e\+12 m, but is 1e\+300"):
        ac.Path.polyline([[1e300, 0.0], [0.0, 0.0]])
    with pytest.raises(ac.InvalidInput, match="speed must be at least 1e-30 m/s"):
        ac.Limits(speed=5e-324)
    with pytest.raises(ac.InvalidInput, match=r"joint_lower must be between"):
        ac.Limits(joint_lower=np.array([-1e300]))


def test_a_memory_error_has_a_sentence() -> None:
    assert _memory.describe_memory_error().endswith(".")


def test_the_default_bound_is_half_of_the_machine_and_at_least_two_gigabytes() -> None:
    whole = _memory.machine_memory()
    assert job().memory == _memory.DEFAULT == max(2e9, 0.5 * (whole or 0.0))
    # Job files of all machines have the same schema.
    assert job(memory=None).memory == _memory.DEFAULT
