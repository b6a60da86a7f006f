"""Identify and learn on LinuxCNC: `python -m soak.robot_loop`.

The job's gains differ from those of the drives. `soak.hal_drives` computes the errors. The exit
code is 1 if one is too large.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

import armcontour as ac
from armcontour.controllers import LinuxCNC, identify_on, learn_on, play
from armcontour.files import parse_job
from soak.hal_drives import CYCLE, KP, KV, LIMIT, distances, tool

JOB = """
name: loop
arm: pmk3s
seed: [0, 1]
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 20 1/s, kv: 120 1/s}
runs:
  go: {timing: {reserve: 2 %}, compensation: {method: inverse}, cycle: 4 ms}
"""
# Largest excess of the RMS contour error with the identified servo over the predicted one [m].
BEYOND = 1e-7
# Largest RMS contour error of the last learning run [m].
LEARNED = 1e-7
# The same for a robot that the model does not describe [m].
UNKNOWN = 1e-5
ATTEMPTS = 5


def robot(**parameters: float) -> LinuxCNC:
    """Make drives whose loops are one cycle late."""
    servo = ac.ServoModel(kp=KP, kv=KV, dead_time=CYCLE, acceleration_limit=LIMIT)
    return LinuxCNC(drives=servo.replace(**parameters))


def error(measured: np.ndarray, duration: float) -> float:
    """Return the RMS contour error during a plan [m]."""
    points = tool(measured[: round(duration * 1e3)])
    return float(np.sqrt(np.mean(distances(points) ** 2)))


def identify_and_play(job: ac.Job) -> tuple[float, float]:
    """Return the RMS contour error with the identified servo, and the predicted one [m]."""
    fit = identify_on(job, robot(), execute=True).fit
    assert fit is not None
    servo = fit.servo_model()
    known = replace(job, servo=servo, plant_servo=servo)
    for _ in range(ATTEMPTS):
        played = play(known, robot(), execute=True, override=1.0)
        if played.record is not None and played.record.faithful:
            break
    plan = played.plan
    assert plan.evaluation is not None
    end = plan.trajectory.duration - plan.set_points.start_time
    return error(played.log.measured, end), plan.evaluation.contour_error.rms


def learn_runs(job: ac.Job, on: LinuxCNC, reserve: float) -> tuple[list[float], str]:
    """Return the RMS contour error of each run [m], and why learning ended."""
    # The first run without reserve leaves the default band.
    result = learn_on(job, on, execute=True, reserve=reserve, band=0.2)
    end = result.plan.trajectory.duration - result.plan.set_points.start_time
    return [error(x.measured, end) for x in result.logs], result.ended


def main() -> int:
    """Print the figures; returns the exit code."""
    job = parse_job(JOB)
    wrong = []
    measured, predicted = identify_and_play(job)
    print(f"identified: {measured * 1e3:.6f} mm RMS, predicted {predicted * 1e3:.6f}", flush=True)
    if measured > predicted + BEYOND:
        wrong.append("The identified servo misses its prediction.")
    for name, on, reserve, bar in (
        ("learned", robot(), 0.2, LEARNED),
        ("unknown robot", robot(ki=4.0), 0.2, UNKNOWN),
        ("unknown robot without reserve", robot(ki=4.0), 0.02, np.inf),
    ):
        errors, ended = learn_runs(job, on, reserve)
        listed = ", ".join(f"{x * 1e3:.6f}" for x in errors)
        print(f"{name}: {listed} mm RMS; {ended or 'may go on'}", flush=True)
        if errors[-1] > bar or (np.isfinite(bar) and (np.diff(errors) >= 0).any()):
            wrong.append(f"The errors of {name} do not fall.")
        if not np.isfinite(bar) and not ended:
            wrong.append(f"Learning of {name} does not end.")
    print("\n".join(wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
