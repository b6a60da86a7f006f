"""How a controller reads the samples of a feeder process, which is a script here."""

import sys

import numpy as np
import pytest

import armcontour as ac
from armcontour.controllers import Controller, Motion

# Plays each motion at once: samples of the motion before, then one per row, which is as commanded.
# The motion ends after a request to stop, or many passes of the controller's loop.
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
    elif kind == "P":
        rows.append(" ".join(words))
    elif kind == "G":
        lines = [f"s {k} {k} 9.0 9.0 9.0 9.0" for k in stale]
        lines += [f"s {100 + k} {k} {row} {row}" for k, row in enumerate(rows)]
        print("\\n".join(lines), flush=True)
        passes = PASSES
    elif kind == "S":
        passes = 1
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
    q = np.linspace([0.0, 0.0], [0.1, 0.2], 6)
    motion = Motion(q=q, predicted=q, band=np.array([0.01, 0.01]))
    with Scripted(stale) as on:
        on.connect(arm, q[0])
        record = on.stream(motion)
    assert record.deviated == deviates
    assert bool(record.notes) == deviates
    assert np.array_equal(record.command[-6:], q)
