"""Learning from log files: the logs have 125 Hz, degrees and a clock with an unknown offset."""

import tempfile
from pathlib import Path

import numpy as np

import armcontour as ac

arm = ac.load_arm("pmk3s")
servo = ac.ServoModel(kp=25.0, kv=150.0)
corner = ac.Path.polyline([(0.30, 0.20), (0.36, 0.20), (0.36, 0.24)])
path = ac.round_corners(corner, tolerance=2e-3)
limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
planned = ac.plan(path, arm, limits)
set_points = ac.compensate(planned, servo, ac.InverseDynamics(), cycle=4e-3, arm=arm)


def write_log(file: Path, executed: ac.Execution, seed: int) -> None:
    """Write the log of a controller: time, set-points and measured positions."""
    t = np.arange(executed.t[0] - 0.3, executed.t[-1] + 0.3, 0.008)
    noise = 1e-6 * np.random.default_rng(seed).standard_normal((len(t), arm.dof))
    times = executed.set_points.t
    u = np.stack([np.interp(t, times, x) for x in executed.set_points.q.T], axis=1)
    q = np.stack([np.interp(t, executed.t, x) for x in executed.q.T], axis=1) + noise
    table = np.column_stack([t + 1234.567, np.degrees(u), np.degrees(q)])
    titles = "t [s],command 1 [deg],command 2 [deg],measured 1 [deg],measured 2 [deg]"
    np.savetxt(file, table, "%.7f", ",", header=titles, comments="")


robot = ac.RigidBodyPlant(arm, servo.replace(kp=[25.0, 24.0]))
errors = []
with tempfile.TemporaryDirectory() as folder:
    for run in range(1, 4):
        executed = ac.simulate(set_points, robot)
        error = ac.evaluate(executed, path).contour_error
        errors.append(error)
        print(f"run {run}: {error.rms * 1e3:.4f} mm RMS, {error.max * 1e3:.4f} mm at most")
        log = Path(folder) / f"run{run}.csv"
        write_log(log, executed, run)
        set_points = ac.learn(set_points, ac.read_log(log), arm=arm, servo=servo)
        begun = -set_points.runs[-1].offset
        rms = set_points.runs[-1].rms
        print(f"  the log shows {rms * 1e3:.4f} mm; the run began at {begun:.4f} s")
print(f"best run: {set_points.best + 1}; finished: {set_points.finished}")
