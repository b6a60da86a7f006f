"""Result folders of runs that are killed."""

import os
import subprocess
import sys

import pytest
from tests.files.test_results import contents, write

from armcontour.core.errors import InvalidInput
from armcontour.files import ResultFolder

KILLED = """
import os, sys
from pathlib import Path
from armcontour.files import ResultFolder

moves = 0
def rename(a, b, inner=os.rename):
    global moves
    if moves == int(sys.argv[2]):
        os.kill(os.getpid(), 9)
    moves += 1
    inner(a, b)

with ResultFolder(Path(sys.argv[1]), force=True) as folder:
    for name in ("new/set_points.csv", "report.html", "summary.json"):
        folder.write(name, f"newer {name}")
    os.rename = rename
print("not killed")
"""


def texts_in(folders, names):
    """Return the texts of those files that are in any of the folders, by name."""
    texts = {}
    for folder in folders:
        for name in names:
            file = folder / name
            if file.exists():
                texts[name] = file.read_text()
    return texts


@pytest.mark.parametrize("moves", range(9))
def test_a_killed_replacement_is_incomplete_and_loses_nothing(tmp_path, moves):
    out = tmp_path / "out"
    write(out, ["old/set_points.csv", "report.html"])
    old = {x: (out / x).read_text() for x in contents(out)}
    command = [sys.executable, "-c", KILLED, str(out), str(moves)]
    outcome = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ("not killed" in outcome.stdout) == (moves == 8), outcome.stderr
    if moves == 8:
        assert contents(out) == {"new/set_points.csv", "report.html", "summary.json"}
        return
    assert (out / "summary.json").exists() == (moves == 0)
    hidden = out / ".armcontour-next" / ".old"
    assert texts_in((out, hidden), old) == old
    if moves:
        with pytest.raises(InvalidInput, match="was killed"):
            ResultFolder(out, force=True)
        assert texts_in((out, hidden), old) == old


def test_the_next_run_removes_the_files_of_a_killed_run(tmp_path):
    out = tmp_path / "out"
    subprocess.run([sys.executable, "-c", KILLED, str(out), "0"], timeout=60)
    assert os.listdir(out) == [".armcontour-next"]
    write(out, ["report.html"])
    assert contents(tmp_path) == {"out/report.html", "out/summary.json"}
