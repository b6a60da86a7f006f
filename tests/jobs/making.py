"""Helpers that make jobs and runs with few arguments."""

import armcontour as ac
from armcontour.jobs import Job, Run

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def a_run(name="one", **values):
    """An optimal run with the inverse of the servo every 4 ms, but for the given values."""
    return Run(name=name, **values)


def a_job(path, *runs, arm=ARM, process=None):
    process = process or ac.Process()
    values = {"servo": SERVO, "plant_servo": SERVO, "process": process, "runs": runs}
    return Job(name="j", title="j", arm=arm, path=path, **values)
