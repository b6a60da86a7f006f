"""Arms in space without the extra `dynamics`: planning, simulation, reports."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac

ROOT = Path(__file__).parents[1]
HOME = np.array([0.3, -1.5, 1.5, -1.2, -1.5, 0.0])
BLOCKED = (
    "import sys; sys.modules.update(pinocchio=None, coal=None); "
    "from tests.test_without_dynamics import print_results; print_results(sys.argv[1])"
)
READY = {"panda": [0.3, 0.2, 0.1, -1.8, 0.2, 2.0, 0.3], "ur5e": HOME}


def results(name, folder):
    """Plan with limits of torque, execute on two plants, and write a report."""
    arm = ac.load_arm(name)
    q, servo = np.array(READY[name]), ac.ServoModel(kp=25.0, kv=150.0)
    line = ac.Path.polyline(arm.tool_position([q, q]) + [[0, 0, 0], [0, 0.06, -0.04]])
    path = line.oriented(arm.forward(q)[:3, :3])
    loose = ac.Limits(joint_velocity=3.0, joint_acceleration=20.0)
    # Little more than gravity needs.
    torque_limits = 1.2 * np.abs(arm.dynamics.gravity(q)) + 1.0
    arm = arm.with_limits(loose)
    plan = ac.plan(path, arm, loose.replace(joint_torque=torque_limits), ac.Optimal(seed=q))
    assert plan.duration > ac.plan(path, arm, loose, ac.Optimal(seed=q)).duration
    torque = arm.torque(*plan.motion(np.linspace(0, plan.duration, 500)))
    assert (np.abs(torque) <= torque_limits * (1 + 1e-6)).all()
    commands = ac.compensate(plan, servo, ac.InverseDynamics(), arm=arm)
    plants = ac.ServoPlant(arm, servo), ac.RigidBodyPlant(arm, servo, plan.limits)
    errors = [ac.evaluate(ac.simulate(commands, x), path) for x in plants]
    ac.write_report(errors[1], folder / f"{name}.html")
    return [plan.duration, *(x.contour_error.rms for x in errors)]


def print_results(folder):
    """Print what the arms do, as JSON."""
    figures = {name: results(name, Path(folder)) for name in READY}
    print(json.dumps(figures))


def test_arms_in_space_need_no_pinocchio(tmp_path):
    pytest.importorskip("mujoco")
    command = [sys.executable, "-W", "ignore", "-c", BLOCKED, str(tmp_path)]
    outcome = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stderr
    data = json.loads(outcome.stdout)
    for name in READY:
        duration, servo, bodies = data[name]
        assert 0.5 < duration < 1 and servo < 1e-3 and bodies < 1e-3
        assert (tmp_path / f"{name}.html").stat().st_size > 1e6
