"""Program that adds a limit with one record and one class, and prints what follows as JSON.

The limit is the acceleration along the path. It needs a process of its own, because the modules are
changed before they are imported: the record is a field of `Limits`, the class a constraint of the
planner and its name in `FROM_LIMITS`. Both are added to the texts of the modules.
"""

from __future__ import annotations

import importlib.util
import json
import sys
import types
from pathlib import Path

NAME = "path_acceleration"
READ = "\ndef _read_records("
LAST_FIELD = "    removed: frozenset[str]"
LAST_TEXT = "\n    Attributes:\n        removed:"
TEXT = "        path_acceleration: Largest acceleration of the tool along the path [m/s²].\n"
RECORD = """    path_acceleration: Annotated[
        AccelerationLimit | None,
        Limit(2, rate=_along),
    ] = None
"""
RATE = '''
def _along(states):
    """Absolute acceleration along the path, and a bound on its error."""
    velocity, (size, error) = states.tool_velocity, states.measure("tool_acceleration")
    speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-9)
    return np.abs((velocity * states.tool_acceleration).sum(axis=1)) / speed, error

'''
FROM_LIMITS = "\n# Kinds of constraints that the planner makes from `Limits`"
LAST_KIND = ")\n\n\ndef constraints_of("
CONSTRAINT = '''
class PathAcceleration(ToolConstraint):
    """Limit `|a u + b x| <= limit`, with the derivatives of the tool's way along its path."""

    serves = ("path_acceleration",)
    name = LIMITS["path_acceleration"].label

    def discretize(self, path):
        first, second = self.arm.tool_motion(*path.motion)
        speed = np.linalg.norm(first, axis=1)
        along = (first * second).sum(axis=1) / speed
        terms = tuple(x[:, None] for x in (speed, along, 0 * speed))
        bound = np.array([self.limit])
        return (path.rows(terms, -bound, bound),)

'''


def import_changed(name, added):
    """Import a module of the package with texts added before places that occur once."""
    spec = importlib.util.find_spec(name)
    text = Path(spec.origin).read_text(encoding="utf-8")
    for before, addition in added.items():
        assert text.count(before) == 1
        text = text.replace(before, addition + before)
    module = types.ModuleType(name)
    package, _, last = name.rpartition(".")
    sys.modules[name] = module
    sys.modules[package].__dict__[last] = module
    exec(compile(text, spec.origin, "exec"), module.__dict__)


def add_record():
    """Add the field of `Limits`."""
    added = {READ: RATE, LAST_TEXT: TEXT, LAST_FIELD: RECORD}
    import_changed("armcontour.robot.limits", added)


def add_class():
    """Add the constraint, and its name in the constraints that the planner makes from limits."""
    added = {FROM_LIMITS: CONSTRAINT, LAST_KIND: "    PathAcceleration,\n"}
    import_changed("armcontour.planning.constraints", added)


JOB = """
name: x
arm: pmk3s
seed: [0, 1]
path: {points: [[0.350, 0.100], [0.380, 0.125], [0.350, 0.160]]}
corners: {tolerance: 2 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s², path_acceleration: LIMIT}
certificate: {servo_error: 20 um}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {timing: {method: METHOD}, compensation: {method: inverse}}}
"""


def along(arm, motion):
    """Largest acceleration along the path at 20,001 times, by differences of tool speeds [m/s²]."""
    import numpy as np

    t = np.linspace(0.0, motion.duration, 20_001)
    steps = np.linalg.norm(np.diff(arm.tool_position(motion(t)), axis=0), axis=1)
    return float(np.abs(np.diff(steps)).max() / (t[1] - t[0]) ** 2)


def facts():
    """What each consumer makes of the new limit."""
    import numpy as np
    from tests.controllers.simulated import Simulated
    from tools.job_form import form_text

    import armcontour as ac
    from armcontour.core.render import limit_style
    from armcontour.planning import explain
    from armcontour.planning.override_ramps import override_of

    def job_of(limit, method="optimal"):
        return ac.files.parse_job(JOB.replace("LIMIT", limit).replace("METHOD", method))

    job = job_of("100 mm/s²")
    arm = job.arm
    (run,) = job.runs
    limits = run.limits
    yield "read", limits.path_acceleration
    result = ac.run(job)
    trajectory = result.runs["only"].trajectory
    free = ac.run(job_of("inf")).runs["only"].trajectory
    smooth = ac.run(job_of("100 mm/s², joint_jerk: 30")).runs["only"].trajectory
    certificate = ac.certify(job)
    override = override_of(trajectory, 1e-3, for_play=False)
    stops = []
    for t in (0.2 * trajectory.duration, 0.4 * trajectory.duration, 0.6 * trajectory.duration):
        paused = override.change(override.begin(1.0, delay=t), t, 0.0)
        stops.append(paused.scaling.trajectory(trajectory))
    yield (
        "along",
        {
            **{
                "free": along(arm, free),
                "planned": along(arm, trajectory),
                "jerk": along(arm, smooth),
            },
            **{"certified": along(arm, certificate.trajectory)},
            **{"stopped": max(along(arm, x) for x in stops)},
        },
    )
    yield "explained", explain(trajectory, arm, limits).kinds
    yield "drawn", limit_style("path acceleration")
    yield "ratio", result.runs["only"].evaluation.limit_ratios[NAME]
    t = np.linspace(0.0, free.duration, 2001)
    samples = types.SimpleNamespace(t=t, q=free(t), dq=free(t, 1), ddq=free(t, 2))
    positions = types.SimpleNamespace(t=t, q=free(t))
    motions = {"planned": trajectory, "free": free, "samples": samples, "positions": positions}
    checks = {name: ac.check(x, arm, limits) for name, x in motions.items()}
    yield "checked", {name: x.verdict for name, x in checks.items()}
    yield "violations", [x.name for x in checks["samples"].violations]
    yield "not judged", checks["positions"].missing
    yield "certificate", str(certificate)
    yield "slowed", along(arm, trajectory.stretched(0.5))
    try:
        ac.play(job_of("100 mm/s²", "paper"), Simulated(), override=1.0)
    except ac.NotRealizable as error:
        yield "refused", [error.limit, error.allowed]
    (group,) = (x for x in json.loads(form_text())["groups"] if x["title"] == "Speed")
    (field,) = (x for x in group["fields"] if x["at"] == f"limits.{NAME}")
    yield "form", [field["unit"], field["text"]]


if __name__ == "__main__":
    add_record()
    add_class()
    print(json.dumps(dict(facts())))
