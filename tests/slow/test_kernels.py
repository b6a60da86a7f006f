"""Compiled functions in processes of their own: messages, memory, the command `compile`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armcontour

PACKAGE = Path(armcontour.__file__).parent
FREED_AGAIN = """
import resource
import numpy as np
import armcontour.core.kernels

def work():
    arrays = [np.ones(24_000) for _ in range(8)]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    del arrays
    arrays = [np.ones(24_000) for _ in range(8)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

work()
print(min(work() for _ in range(5)))
"""
LOADED = """
import sys
import numpy as np
from armcontour.planning import paper_line

ends = np.zeros((2, 2)), np.ones((2, 2))
before = set(sys.modules)
paper_line.run_laps(*ends, 0.1, np.arange(2.0))
assert sum(paper_line.run_laps.stats.cache_hits.values()) == 1
# They declare to the compiler what can be called.
print(*(x for x in set(sys.modules) - before if x.startswith("numba.core.typing")))
"""
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


@pytest.mark.skipif(sys.platform != "linux", reason="counts page faults as Linux does")
def test_memory_that_is_freed_is_used_again():
    # 8 arrays of 192 kB each take 376 pages, which the system would have to clear.
    assert int(run(FREED_AGAIN).stdout) < 40


def test_loading_imports_nothing_that_only_compiling_needs():
    # It takes longer than a short plan.
    from armcontour.planning import paper_line

    paper_line.run_laps(np.zeros((2, 2)), np.ones((2, 2)), 0.1, np.arange(2.0))
    assert run(LOADED).stdout.split() == []


def test_a_compiled_function_is_not_compiled_again(tmp_path):
    point = "Tuple((float64, float64, float64, ))"
    text = f"- armcontour.geometry.kernels.find_foot({point}, float64[::1])\n"
    gone = "- armcontour.geometry.kernels.gone(float64)\n"
    (tmp_path / "list.txt").write_text(text + gone)
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": str(PACKAGE.parent)}

    def compile_all():
        return run(WARM, str(tmp_path / "list.txt"), **variables).stdout.strip().split("|")

    functions, compiled, folder, *steps = compile_all()
    assert (functions, compiled) == ("2", "1") and folder.startswith(str(tmp_path / "kept"))
    assert steps[0].startswith("compiling, once: 2 functions in ")
    assert steps[-1].endswith(": geometry.kernels.find_foot")
    # The second time it reports no steps.
    assert compile_all() == ["2", "0", folder]
    shutil.rmtree(tmp_path / "kept")
    assert compile_all()[1] == "1"
