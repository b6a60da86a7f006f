"""Memory of a server that runs."""

import subprocess
import sys

import pytest

SERVING = """
import gc, os, threading, time
import numpy as np
from armcontour.studio.server import serve

PAGE = os.sysconf("SC_PAGE_SIZE")

def used():
    with open("/proc/self/statm") as told:
        return int(told.read().split()[1]) * PAGE / 2**20

class Session:
    def begin(self):
        threading.Thread(target=work, daemon=True).start()

    def look(self):
        pass

    def close(self):
        pass

def work():
    while not gc.get_freeze_count():
        time.sleep(0.01)
    # Executions of a long motion, and what is kept of a short one that follows.
    del [np.ones(3 * 2**20)][0]
    before = used()
    many = [np.ones(2**20) for _ in range(20)]
    kept = bytes(2**16)
    most = used()
    del many
    print(before, most, used(), gc.get_freeze_count(), flush=True)
    desks[0].stop()

desks = []
serve(lambda say: Session(), announce=lambda address: None, opened=desks.append)
print(gc.get_freeze_count())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries give memory back otherwise")
def test_memory_of_executions_goes_back_and_what_is_loaded_is_no_garbage():
    outcome = subprocess.run(
        [sys.executable, "-c", SERVING], capture_output=True, text=True, timeout=60, check=True
    )
    printed, frozen_after = outcome.stdout.splitlines()
    before, peak, after, frozen = map(float, printed.split())
    assert peak - before > 100
    assert after - before < 40
    assert frozen > 10_000 and frozen_after == "0"
