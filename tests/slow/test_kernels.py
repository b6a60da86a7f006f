"""The command `compile` in processes of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import armcontour

PACKAGE = Path(armcontour.__file__).parent
WARM = """
import sys
from pathlib import Path
from armcontour.core import compilation
compilation.LIST = Path(sys.argv[1])
steps = []
found = compilation.compile_kernels("all", steps.append)
print(found.functions, found.compiled, found.folder, *map(str, steps), sep="|")
"""


def run(code, *arguments, **variables):
    """A process that runs some code."""
    line = [sys.executable, "-c", code, *arguments]
    return subprocess.run(
        line, capture_output=True, text=True, check=True, env=os.environ | variables
    )


def test_without_a_writable_folder_the_command_compile_states_the_remedy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "armcontour", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in {x.parent for x in (tmp_path / "armcontour").rglob("*.py")}:
        (folder / "__pycache__").write_text("")
    home = str(tmp_path / "armcontour" / "__pycache__" / "home")
    environment = os.environ | {"HOME": home, "XDG_CACHE_HOME": home, "PYTHONPATH": str(tmp_path)}
    environment["NUMBA_CACHE_DIR"] = ""
    command = [sys.executable, "-m", "armcontour", "compile", "plane"]
    outcome = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert outcome.returncode == 1 and "Set NUMBA_CACHE_DIR" in " ".join(outcome.stderr.split())


def test_a_compiled_function_is_not_compiled_again(tmp_path):
    arrays = "float64[:, ::1], float64[:, ::1]"
    text = f"- armcontour.core.quintics.solve_banded({arrays})\n"
    gone = "- armcontour.geometry.kernels.gone(float64)\n"
    (tmp_path / "list.txt").write_text(text + gone)
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": str(PACKAGE.parent)}

    def compile_all():
        return run(WARM, str(tmp_path / "list.txt"), **variables).stdout.strip().split("|")

    functions, compiled, folder, *steps = compile_all()
    assert (functions, compiled) == ("2", "1") and folder.startswith(str(tmp_path / "kept"))
    assert steps[0].startswith("compiling, once: 2 functions in ")
    assert steps[-1].endswith(": core.quintics.solve_banded")
    # The second time it reports no steps.
    assert compile_all() == ["2", "0", folder]
    shutil.rmtree(tmp_path / "kept")
    assert compile_all()[1] == "1"
