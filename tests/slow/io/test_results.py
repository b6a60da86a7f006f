"""Result folders of runs that are killed, and of many runs at once."""

import os
import subprocess
import sys
import threading

import pytest
from tests.io.test_results import contents, write

from armcontour.errors import InvalidInput
from armcontour.io import ResultFolder

KILLED = """
import os, sys
from pathlib import Path
from armcontour.io import ResultFolder, results

moves = 0
def replace(a, b, inner=os.replace):
    global moves
    if moves == int(sys.argv[2]):
        os.kill(os.getpid(), 9)
    moves += 1
    inner(a, b)

with ResultFolder(Path(sys.argv[1]), force=True) as folder:
    for name in ("new/taught.csv", "report.html", "summary.json"):
        folder.write(name, f"newer {name}")
    os.replace = replace
print("not killed")
"""


@pytest.mark.parametrize("moves", range(6))
def test_a_killed_replacement_never_looks_whole_and_is_completed(tmp_path, moves):
    out = tmp_path / "out"
    write(out, ["old/taught.csv", "report.html"])
    old = {x: (out / x).read_text() for x in contents(out)}
    command = [sys.executable, "-c", KILLED, str(out), str(moves)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    killed = "not killed" not in done.stdout
    assert killed == (moves < 5), done.stderr
    after = {x: (out / x).read_text() for x in contents(out) if not x.startswith(".armcontour")}
    assert after == old or "summary.json" not in after or not killed
    # The next run completes what was begun, then says that the folder is in use.
    with pytest.raises(InvalidInput, match="not empty"):
        ResultFolder(out)
    whole = {"new/taught.csv", "report.html", "summary.json"}
    assert contents(out) == (set(old) if moves == 0 else whole)


def test_what_a_killed_first_run_left_is_cleared(tmp_path):
    out = tmp_path / "out"
    code = KILLED.replace("os.replace = replace", "os.kill(os.getpid(), 9)")
    subprocess.run([sys.executable, "-c", code, str(out), "0"], timeout=60)
    assert any(x.startswith(".armcontour-out-") for x in os.listdir(tmp_path))
    write(out, ["report.html"])
    assert contents(tmp_path) == {"out/report.html", "out/summary.json"}


def test_many_runs_at_once_into_one_folder(tmp_path):
    out = tmp_path / "out"
    ended = []
    gate = threading.Barrier(8)

    def attempt(i):
        gate.wait()
        try:
            write(out, [f"{i}.csv"])
            ended.append("written")
        except InvalidInput:
            ended.append("refused")

    threads = [threading.Thread(target=attempt, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(ended) == ["refused"] * 7 + ["written"]
    assert len(contents(tmp_path)) == 2
