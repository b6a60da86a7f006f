"""No module is imported from the current folder or from the folder of a file."""

import os
import subprocess
import sys

import pytest

JOB = """\
name: corner
arm: pmk3s
path: {points: [[0.30, 0.20], [0.32, 0.20], [0.32, 0.21]]}
limits: {speed: 0.15 m/s, joint_acceleration: 2}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: inverse}, timing: {reserve: 2 %}}
"""
HOSTILE = (
    *("pickle", "copyreg", "typing", "subprocess", "signal", "multiprocessing", "yaml"),
    *("pandas", "pyarrow", "cloudpickle"),
)
PACKAGES = ("numpy", "scipy", "numba", "loky", "armcontour")
OVER = ("--over", "corners.tolerance=[1 mm, 2 mm]")
COMMANDS = {
    "show": ("show", "line.csv"),
    "run": ("run", "job.yaml", "--out", "out"),
    "batch": ("batch", "job.yaml", *OVER, "--out", "out", "--workers", "2"),
    "place": ("place", "job.yaml", "--out", "out", "--x", "-5 mm .. 5 mm, 13",
              "--workers", "2"),
    "check": ("check", "q.csv", "--arm", "pmk3s"),
}  # fmt: skip
COMMAND = "from armcontour.cli import main; main()"
# A program that runs in the folder, but was started from another one.
PROGRAM = """
import armcontour as ac
found = ac.batch('job.yaml', {'corners.tolerance': ['1 mm', '2 mm']}, 'out', workers=2)
assert len(found.rows) == 2, found
"""


@pytest.fixture
def hostile(tmp_path):
    """A folder with a job, and with modules that leave a file when they are imported."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    code = f"import os; open({str(tmp_path / 'imported')!r}, 'a').write(__file__ + '\\n')\n"
    for x in HOSTILE:
        (folder / f"{x}.py").write_text(code)
    for x in PACKAGES:
        (folder / x).mkdir()
        (folder / x / "__init__.py").write_text(code)
        (folder / x / "__main__.py").write_text(code)
    # Numba would load compiled functions from the folder that this file names.
    (folder / ".numba_config.yaml").write_text("cache_dir: compiled\n")
    (folder / "job.yaml").write_text(JOB)
    (folder / "line.csv").write_text("x [m],y [m]\n0.3,0.2\n0.3,0.21\n")
    (folder / "q.csv").write_text("t,q1,q2\n" + "".join(f"{k / 10},0,1\n" for k in range(9)))
    return folder


@pytest.mark.parametrize("name", [*COMMANDS, "program"])
def test_nothing_is_imported_from_the_folder(hostile, name):
    code, arguments = (COMMAND, COMMANDS[name]) if name in COMMANDS else (PROGRAM, ())
    file = hostile.parent / "own" / "command_line.py"
    file.parent.mkdir()
    file.write_text(code)
    line = [sys.executable, file, *arguments]
    environment = {x: y for x, y in os.environ.items() if x != "NUMBA_CACHE_DIR"}
    if name == "program":
        # Commands set it themselves.
        environment["NUMBA_CACHE_DIR"] = ""
    outcome = subprocess.run(line, cwd=hostile, env=environment, capture_output=True, text=True)
    assert outcome.returncode == 0, outcome.stderr
    assert not (hostile.parent / "imported").exists()
    assert not (hostile / "compiled").exists()
