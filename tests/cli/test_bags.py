"""Commands that read bags of ROS 2, compared with the same motion as a table."""

import re

import numpy as np
import pytest
from soak.identification import move
from tests.files.bags import JOINT_STATE, STAMP, STATE, controller_state, joint_state, write_db3

import armcontour as ac

pytest.importorskip("rosbags")

NAMES = ac.load_arm("ur5e").joint_names
STEP = 8_000_000


def run_both(command_in, folder, line):
    """Run a command on FILE, once a bag and once the table; codes and outputs without times."""
    outputs = []
    for name in ("run.db3", "run.csv"):
        ended = command_in(folder, *line.replace("FILE", name).split())
        printed = f"{ended.out}\n{ended.errors}".replace(name, "FILE").splitlines()
        # Rows of tables have other numbers than messages.
        kept = [re.sub(r" \((row|line) \d+\)", "", x) for x in printed if "Times of" not in x]
        outputs.append((ended.code, kept))
    return outputs


def test_check_of_a_bag_equals_that_of_a_table(command_in, tmp_path):
    """Also a gap in the recording is noticed."""
    used = [i for i in range(80) if not 20 < i < 60]
    t = 1e-9 * STEP * np.arange(80)
    q = np.array([0.3, -1.2, 1.5, -1.8, -1.6, 0.4]) + 0.03 * np.sin(9 * t[:, None] + np.arange(6))
    dq = 0.27 * np.cos(9 * t[:, None] + np.arange(6))
    messages = [joint_state(NAMES, STAMP + STEP * i, q[i], dq[i]) for i in used]
    rows = [("/joint_states", JOINT_STATE, STAMP + i, x) for i, x in enumerate(messages)]
    write_db3(tmp_path / "run.db3", rows)
    head = ",".join(["t [s]", *(f"measured {x}" for x in NAMES), *(f"dq {x}" for x in NAMES)])
    table = np.column_stack([t, q, dq])[used]
    np.savetxt(tmp_path / "run.csv", table, "%.17g", ",", header=head, comments="")
    bag, csv = run_both(command_in, tmp_path, "check FILE --arm ur5e")
    assert bag == csv and bag[0] == 7


def test_identification_of_a_bag_equals_that_of_a_table(command_in, tmp_path):
    t = 4e-3 * np.arange(2000)
    rng = np.random.default_rng(3)
    phases = rng.uniform(0, 6, (2, 8))
    waves = 2 * np.pi * np.linspace(0.3, 4, 8)
    u = 0.05 * np.sin(t[:, None, None] * waves + phases).sum(axis=2)
    u *= np.minimum(1, t / 0.5)[:, None]
    q = np.column_stack([move(t, x, kp=25.0, kv=150.0, delay=12e-3) for x in u.T])
    q += 1e-6 * rng.normal(size=q.shape)
    rows = []
    for i in range(len(t)):
        stamp = STAMP + 4_000_000 * i
        # The joints are in the opposite order in the bag.
        message = controller_state(["elbow", "shoulder"], stamp, u[i, ::-1], q[i, ::-1])
        rows.append(("/c/controller_state", STATE, stamp, message))
    write_db3(tmp_path / "run.db3", rows)
    head = "t [s],command elbow,command shoulder,measured elbow,measured shoulder"
    table = np.column_stack([t, u[:, ::-1], q[:, ::-1]])
    np.savetxt(tmp_path / "run.csv", table, "%.17g", ",", header=head, comments="")
    bag, csv = run_both(command_in, tmp_path, "identify FILE --topic /c/controller_state")
    assert csv[0] == 2 and "has no topics" in "".join(csv[1])
    bag, csv = run_both(command_in, tmp_path, "identify FILE")
    assert bag == csv and bag[0] in (0, 9)
    assert any("elbow" in x for x in bag[1])
