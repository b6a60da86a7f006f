"""`python -m tools.ship dist`: make a second wheel, with compiled functions, from the plain one.

The functions are compiled for this Python and a common processor. Inner functions have no files,
because their callers contain their code. The compiled functions are kept for the
next call in `NUMBA_CACHE_DIR`, or in `.armcontour`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from armcontour.core import compilation, kernel_cache

# As the wheels of numba and SciPy. The compiled functions use no library of the system.
PLATFORM = "manylinux_2_17_x86_64"
FOLDER = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(__file__).parents[1] / ".armcontour")


def main() -> None:
    """Write the wheel with compiled functions."""
    platform, processor, features = kernel_cache.SHIPPED_TARGET
    if not kernel_cache.runs_shipped():
        print(f"No wheel with compiled functions: it is made on {platform} with AVX2 only.")
    elif kernel_cache.target() != kernel_cache.SHIPPED_TARGET:
        # Numba reads these variables when it is imported.
        variables = {
            "NUMBA_CPU_NAME": processor,
            "NUMBA_CPU_FEATURES": features,
            "NUMBA_CACHE_DIR": str(FOLDER / processor),
        }
        again = [sys.executable, "-m", "tools.ship", *sys.argv[1:]]
        subprocess.run(again, check=True, env=os.environ | variables)
    else:
        ship(Path(sys.argv[1]))


def ship(folder: Path) -> None:
    """Compile all functions, and add them to a copy of the plain wheel in a folder."""
    (plain,) = folder.glob("*-none-any.whl")
    with tempfile.TemporaryDirectory() as name:
        wheel("unpack", str(plain), "--dest", name)
        (tree,) = Path(name).iterdir()
        differ = [x for x in compilation.used_sources() if changed(x, tree)]
        if differ:
            sys.exit(f"{plain.name} has other sources: {', '.join(map(str, differ))}")
        compiled = compilation.compile_kernels()
        # Other processes may have compiled the functions; an import enters them in `KERNELS`.
        for module, _ in compilation.read_list("all"):
            import_module(module)
        shipped = tree / kernel_cache.SHIPPED.relative_to(kernel_cache.ROOT.parent)
        for kernel in kernel_cache.KERNELS.values():
            if not kernel_cache.is_inner(kernel):
                copy(kernel._cache, shipped)
        compilation.stamp(shipped, "all", kernel_cache.SHIPPED_TARGET)
        wheel("pack", str(tree), "--dest-dir", name)
        (packed,) = Path(name).glob("*.whl")
        python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
        wheel("tags", "--python-tag", python, "--platform-tag", PLATFORM, str(packed))
        (made,) = Path(name).glob(f"*-{python}-*.whl")
        shutil.copy(made, folder)
    print(f"{made.name}: {compiled.compiled} of {compiled.functions} functions compiled now.")


def changed(source: Path, tree: Path) -> bool:
    """Return whether a source differs from that of an unpacked wheel."""
    packed = tree / source.relative_to(kernel_cache.ROOT.parent)
    return packed.read_bytes() != source.read_bytes()


def copy(cache: Any, shipped: Path) -> None:
    """Copy the files of a compiled function."""
    index = cache._cache_file
    package = Path(cache._py_func.__code__.co_filename).parent.relative_to(kernel_cache.ROOT)
    (shipped / package).mkdir(parents=True, exist_ok=True)
    for name in (index._index_name, *index._load_index().values()):
        shutil.copy(Path(index._cache_path) / name, shipped / package)


def wheel(*arguments: str) -> None:
    """Call the program `wheel`."""
    command = [sys.executable, "-m", "wheel", *arguments]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    main()
