"""How a controller reads the samples of a feeder process, which is a script here."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac
from armcontour.controllers import Controller
from armcontour.controllers.player import uncompensated_motion

# Plays the first block of a motion at once: samples of the motion before, then one per row, which
# is as commanded. It refuses later blocks. The motion ends after many passes of the controller.
SCRIPT = """
import sys
stale = sys.argv[1].split()
PASSES = 50
passes = 0
rows = []
print("R 0.0 0.0", flush=True)
for line in sys.stdin:
    kind, *words = line.split() or [""]
    if kind == "M":
        rows = []
        kept = False
    elif kind == "C":
        number = words[0]
    elif kind == "E":
        print("B" if kept else "K", number, flush=True)
        kept = True
    elif kind == "P" and not kept:
        rows.append(" ".join(words))
    elif kind == "G":
        lines = [f"s {k} {k} 9.0 9.0 9.0 9.0" for k in stale]
        lines += [f"s {100 + k} {k} {row} {row}" for k, row in enumerate(rows)]
        print("\\n".join(lines), flush=True)
        passes = PASSES
    elif kind == "Q":
        break
    # The controller sends an empty line before it reads the samples.
    passes -= 1
    if passes == 0:
        print("D", flush=True)
"""


class Scripted(Controller):
    """A feeder that first sends samples with these cycles, at other positions."""

    name = "scripted"

    def __init__(self, stale):
        super().__init__()
        self.stale = stale

    def _command(self, arm, start, folder):
        file = folder / "feeder.py"
        file.write_text(SCRIPT, encoding="utf-8")
        return [sys.executable, str(file), self.stale], {}


@pytest.mark.parametrize(("stale", "deviates"), [("-1 7 8 -1", False), ("0", True)])
def test_samples_of_the_motion_before_are_not_compared(stale, deviates):
    arm = ac.load_arm("pmk3s")
    line = ac.JointPath.spline(np.array([[0.0, 0.0], [0.1, 0.2]]), [0.0, 1.0])
    trajectory = ac.plan(line, arm, arm.limits, ac.Optimal(reserve=0.05))
    moved = uncompensated_motion(trajectory, arm, Scripted.cycle)
    motion = replace(moved, band=np.array([0.01, 0.01]), moving_band=None)
    with Scripted(stale) as on:
        on.connect(arm, motion.q[0])
        record = on.stream(motion)
    assert record.deviated == deviates
    assert any("from its predicted position" in x for x in record.notes) == deviates
    count = len(record.command) - (stale == "0")
    np.testing.assert_allclose(record.command[-count:][:300], motion.q[:300], atol=1e-12)
