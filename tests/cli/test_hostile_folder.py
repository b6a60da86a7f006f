"""Nothing of the current folder is imported; tests/slow/cli runs more commands."""

import os
import subprocess
import sys


def test_a_command_imports_nothing_from_its_folder(tmp_path):
    folder = tmp_path / "stranger"
    folder.mkdir()
    code = f"import os; open({str(tmp_path / 'imported')!r}, 'a').write(__file__ + '\\n')\n"
    for x in ("pickle", "typing", "yaml", "numpy", "scipy", "numba", "armcontour"):
        (folder / f"{x}.py").write_text(code)
    # Numba would load compiled functions from the folder that this file names.
    (folder / ".numba_config.yaml").write_text("cache_dir: compiled\n")
    (folder / "line.csv").write_text("x [m],y [m]\n0.3,0.2\n0.3,0.21\n")
    main = "from armcontour.cli import main; main()"
    line = [sys.executable, "-P", "-c", main, "show", "line.csv"]
    own = {x: y for x, y in os.environ.items() if x != "NUMBA_CACHE_DIR"}
    done = subprocess.run(line, cwd=folder, env=own, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "imported").exists() and not (folder / "compiled").exists()
