"""Processes that are halted or killed while joints of a HAL file move."""

import json
import subprocess
import sys

import pytest
from soak.failures import CASES, MOMENTS
from tests.controllers.test_linuxcnc import needs_linuxcnc, needs_own_hal

pytestmark = [needs_linuxcnc, needs_own_hal]
# Case and moment of the motion.
CHOSEN = [
    (("nothing", None), 11),
    (("guard", None), 3),
    (("child", None), 5),
    (("child", 0.5), 8),
    (("feeder", 0.2), 2),
    (("feeder", 0.5), 6),
    (("feeder", 2.0), 4),
    (("feeder", None), 7),
    (("player", None), 5),
    (("player", 1.0), 3),
    (("feeder and player", None), 6),
    (("rtapi", None), 4),
    (("rtapi", 0.5), 6),
    (("disk", None), 3),
]


@pytest.mark.parametrize(("case", "moment"), CHOSEN, ids=str)
def test_joints_stop_and_drives_are_disabled_with_a_log(case, moment):
    seed = CASES.index(case) + len(CASES) * moment
    assert moment < MOMENTS
    words = ["unshare", "--ipc", "--mount", sys.executable, "-m", "soak.failures", str(seed)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    if "this machine is too busy" in found["notes"]:
        pytest.skip(found["notes"][0])
    assert not found["notes"]
    assert found["ratio"] <= 1.0
