"""Logs of a simulated robot whose servo differs from that of the job."""

import numpy as np
import pytest
from tools.studio_page import write_job

import armcontour as ac
from armcontour.jobs.run_learning import plan_run

TRUE = ac.ServoModel(kp=24.0, kv=140.0)
HEAD = "t [s],command 1 [rad],command 2 [rad],measured 1 [rad],measured 2 [rad]"
# Drives with something left do not saturate in the learned run. Set-points without a limit of their
# acceleration excite the servo so that a log shows a dead time of 0.05 ms.
RESERVE = [
    (
        "timing: {method: optimal}",
        "timing: {method: optimal, reserve: 10 %}\n    command_limits: {joint_acceleration: inf}",
    )
]
# Clock of the log at the start of the plan [s].
BEGIN = 100.0033


class Robot:
    """A robot that executes a run of a job.

    Args:
        file: The job file.
        run: Name of the run.
    """

    def __init__(self, file, run="optimal"):
        self.file = file
        self.folder = file.parent
        self.job = ac.read_job(file)
        self.plan = plan_run(self.job, run)
        self.plant = ac.ServoPlant(self.job.arm, TRUE)

    def execute(self, set_points=None):
        """The motion of set-points, by default those of the plan."""
        return ac.simulate(set_points or self.plan.set_points, self.plant)

    def table(self, done, seed=0, interval=2e-3):
        """Rows of a log: time, commands and measured positions, with rests around."""
        t = np.arange(done.t[0] - 0.2, done.t[-1] + 0.2, interval)
        u = np.stack([np.interp(t, done.set_points.t, x) for x in done.set_points.q.T], axis=1)
        q = np.stack([np.interp(t, done.t, x) for x in done.q.T], axis=1)
        q += 1e-6 * np.random.default_rng(seed).standard_normal(q.shape)
        return np.column_stack([t + BEGIN, u, q])

    def log(self, file, done=None, seed=0):
        """Write the log of a motion, by default that of the plan."""
        return write_table(file, self.table(self.execute() if done is None else done, seed))


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """A robot with a job in a folder of its own."""
    file = tmp_path_factory.mktemp("logs") / "job.yaml"
    return Robot(write_job(file, "optimal", changes=RESERVE))


@pytest.fixture(scope="module")
def log(robot):
    """The log of the plan."""
    return robot.log(robot.folder / "run.csv")


def write_table(file, rows, head=HEAD):
    """Write a table with the titles of its columns."""
    np.savetxt(file, rows, "%.9f", ",", header=head, comments="")
    return file
