"""Test the archives of a release: `python tools/try_package.py dist`, as `make package` does.

Source archive and plain wheel must contain exactly the files that git tracks, and the wheel must
import. From the wheel with compiled functions, a drawing must run without compiling any; without
AVX, functions are compiled. With `--install`, as in `make slow`, the plain wheel is installed in an
empty environment, where `armcontour demo` has to work outside the repository, without any extra.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import time
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "src/armcontour/"
# Of the repository, but of no use to who has a source archive.
NOT_IN_SOURCES = (".ci/", ".git-blame-ignore-revs", ".github/", ".pre-commit-config.yaml", "conda/")
# The licences of what the package contains from others, as they are called in the repository.
LICENCES = (
    "LICENSE",
    PACKAGE + "files/robots/library/hulls/LICENSE-universal-robots.txt",
    PACKAGE + "files/robots/library/hulls/NOTICE-franka.txt",
    PACKAGE + "report/static/vendor/LICENSES.txt",
)
# Folder of compiled functions in a wheel.
SHIPPED = "armcontour/core/shipped/"
# A command, and a compiled function alone; `counted` prints the names of functions that numba
# compiled meanwhile.
GASKET = """
import sys
from armcontour.cli import main
sys.argv = ["armcontour", "run", {drawing!r}, "--cell", "ur5e", "--out", "out"]
main()
"""
QUINTIC = """
import numpy as np
from armcontour.core.quintics import quintic
ends = np.zeros((3, 1, 1))
assert quintic(np.ones(1), ends, ends).shape == (1, 6, 1)
"""
COUNTED = """
import sys
from numba.core import event
with event.install_recorder("numba:compile") as recorded:
    try:
        exec({code!r})
    except SystemExit as end:
        assert not end.code, end.code
import armcontour
assert armcontour.__file__.startswith(sys.prefix), armcontour.__file__
print("compiled:", *{{x.data["dispatcher"].py_func.__name__ for _, x in recorded.buffer}})
"""
# Motion [s] and RMS contour error [m] of the paper's method, as in docs/start/installing.md.
# The tolerance of 1 % is below the effect of a fault, and above differences between libraries.
PROPOSED = (5.327, 2.28e-6)


def main() -> None:
    """Test the archives of a folder, and print the results."""
    folder = Path(sys.argv[1])
    (sources,) = folder.glob("*.tar.gz")
    (wheel,) = folder.glob("*-any.whl")
    if (ROOT / ".git").exists():
        # The folder may belong to another user, as in a container.
        git = ("git", "-c", f"safe.directory={ROOT}", "-C", str(ROOT))
        tracked = set(run(*git, "ls-files", "-z").split("\0")) - {""}
        try_sources(sources, {x for x in tracked if not x.startswith(NOT_IN_SOURCES)})
        for archive in folder.glob("*.whl"):
            try_wheel(archive, {x for x in tracked if x.startswith(PACKAGE)})
    else:
        print("This is no git repository: the files of the archives were not compared with it.")
    with tempfile.TemporaryDirectory() as name:
        if "--install" in sys.argv:
            try_install(wheel.resolve(), Path(name))
        else:
            try_import(wheel.resolve(), Path(name))
            for shipped in folder.glob("*-manylinux*.whl"):
                try_shipped(shipped.resolve(), Path(name))


def try_sources(archive: Path, expected: set[str]) -> None:
    """Compare a source archive with the expected files."""
    with tarfile.open(archive) as opened:
        names = {x.name.partition("/")[2] for x in opened.getmembers() if x.isfile()}
    compare(archive, names, expected | {"PKG-INFO"})


def try_wheel(archive: Path, expected: set[str]) -> None:
    """Compare a wheel with the expected files: the package and its licences."""
    with zipfile.ZipFile(archive) as opened:
        names = {x for x in opened.namelist() if not x.endswith("/")}
    info = "-".join(archive.name.split("-")[:2]) + ".dist-info/"
    of_package = {x for x in names if not x.startswith(info)}
    if not archive.name.endswith("-any.whl"):
        of_package = {x for x in of_package if not x.startswith(SHIPPED)}
    compare(archive, of_package, {x.removeprefix("src/") for x in expected})
    missing = [x for x in LICENCES if f"{info}licenses/{x}" not in names]
    if missing:
        sys.exit(f"{archive.name} lacks licences: {', '.join(missing)}")


def compare(archive: Path, contained: set[str], expected: set[str]) -> None:
    """End the program if an archive lacks files, or has unexpected ones."""
    for verb, names in (("lacks", expected - contained), ("must not have", contained - expected)):
        if names:
            sys.exit(f"{archive.name} {verb}: {', '.join(sorted(names)[:20])} ({len(names)} files)")
    print(f"{archive.name}: {len(contained)} files, {archive.stat().st_size / 1e6:.1f} MB")


def try_import(wheel: Path, folder: Path) -> None:
    """Import all public names from a wheel with the libraries of this environment."""
    with zipfile.ZipFile(wheel) as opened:
        opened.extractall(folder)
    code = (
        "import sys, armcontour as ac; names = [getattr(ac, x) for x in ac.__all__]; "
        "print(len(names), 'public names of', ac.__file__)"
    )
    print(run(sys.executable, "-c", code, cwd=folder, PYTHONPATH=str(folder)))
    run(sys.executable, "-m", "armcontour", "arms", cwd=folder, PYTHONPATH=str(folder))


def try_shipped(wheel: Path, folder: Path) -> None:
    """Install a wheel with compiled functions by uv and by pip, and count those compiled later."""
    code = GASKET.format(drawing=str(ROOT / "examples" / "drawings" / "gasket.dxf"))
    for name in ("uv", "pip"):
        environment = folder / f"by {name}"
        venv.create(environment)
        python = str(environment / "bin" / "python")
        # The libraries are those of this environment.
        site_packages = sysconfig.get_path("purelib", vars={"base": str(environment)})
        libraries = f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})"
        Path(site_packages, "libraries.pth").write_text(libraries, encoding="utf-8")
        if name == "uv":
            install = ("uv", "pip", "install", "--python", python, "--compile-bytecode")
        else:
            install = ("pip", "--python", python, "install", "--disable-pip-version-check")
        run(sys.executable, "-m", *install, "-q", "--no-deps", str(wheel))
        begin = os.times()
        compiled = count(python, code, environment)
        end = os.times()
        # Other processes may have compiled.
        files = [x.name for x in environment.rglob("*.nbi") if SHIPPED not in x.as_posix()]
        if compiled or files:
            sys.exit(f"{wheel.name}, installed by {name}, compiles {compiled} {files[:3]}.")
        seconds = sum(end[2:4]) - sum(begin[2:4])
        print(f"Gasket after {name}: nothing compiled, {seconds:.1f} s of processor time.")
    if count(python, QUINTIC, environment):
        sys.exit(f"{wheel.name} compiles a function that it contains.")
    if not count(python, QUINTIC, environment, NUMBA_ENABLE_AVX="0"):
        sys.exit(f"{wheel.name} loads a function for AVX where the processor has none.")


def count(python: str, code: str, folder: Path, **variables: str) -> str:
    """Name the functions that numba compiles while code runs with an empty home folder."""
    home = tempfile.mkdtemp(dir=folder)
    empty = {"HOME": home, "XDG_CACHE_HOME": home, "NUMBA_CACHE_DIR": "", "PYTHONPATH": ""}
    printed = run(python, "-c", COUNTED.format(code=code), cwd=Path(home), **empty, **variables)
    return printed.rpartition("compiled:")[2].strip()


def try_install(wheel: Path, folder: Path) -> None:
    """Install a wheel in an empty environment, and run the demo there."""
    began = time.monotonic()
    venv.create(folder / "env", with_pip=True)
    bin_folder = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    # Without bytecode, which takes half of pip's time and is written at the first use.
    tested = "-c", str(ROOT / "constraints.txt")
    pip = (str(bin_folder / "python"), "-m", "pip", "install", "-q", "--no-compile")
    run(*pip, *tested, str(wheel))
    print(f"Installed in {time.monotonic() - began:.0f} s.")
    began = time.monotonic()
    work = folder / "work"
    work.mkdir()
    print(run(str(bin_folder / "armcontour"), "demo", cwd=work))
    print(f"Demo, including the compilation at its first run: {time.monotonic() - began:.0f} s.")
    summary = json.loads((work / "demo" / "summary.json").read_text(encoding="utf-8"))
    files = {"report.html", *(f"{name}/set_points.csv" for name in summary["runs"])}
    missing = [x for x in files if not (work / "demo" / x).is_file()]
    if missing:
        sys.exit(f"The demo lacks files: {', '.join(sorted(missing))}.")
    run_of_paper = summary["runs"]["proposed"]
    figures = run_of_paper["duration"], run_of_paper["contour_error"]["rms"]
    if any(abs(x / y - 1) > 0.01 for x, y in zip(figures, PROPOSED, strict=True)):
        sys.exit(f"The demo's run proposed has {figures}, expected {PROPOSED}.")
    print(run(str(bin_folder / "python"), str(ROOT / "tools" / "install_size.py")))


def run(*command: str, cwd: Path | None = None, **variables: str) -> str:
    """Run a command and return its output; a failure ends the program with its messages."""
    # Without PYTHONPATH, so that the installed package is tested.
    env = {name: x for name, x in os.environ.items() if name != "PYTHONPATH"} | variables
    outcome = subprocess.run(command, cwd=cwd, env=env, text=True, capture_output=True)
    if outcome.returncode:
        sys.exit(
            f"{' '.join(command)} ended with {outcome.returncode}:\n"
            f"{outcome.stdout}{outcome.stderr}"
        )
    return outcome.stdout.rstrip("\n")


if __name__ == "__main__":
    main()
