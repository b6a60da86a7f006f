"""Compare this tree's results with an earlier commit's: `python -m tools.freeze`.

Both trees run the same work on this machine with the same environment: all examples, about sixty
commands, drawings of the tests and drawings with random changes, and `check` on random
trajectories. Recorded are exit codes, the class and data of errors, and all numbers and keys of
results; sentences are not. Records of a commit are kept in `.armcontour/freeze`.

`--renamed FILE` lists renamed names since that commit, one per line: the old name, a tab, the new
name. Keys, values, options and names of files are compared under the new names.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import hashlib
import io
import json
import os
import platform
import re
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator, Mapping
from importlib.metadata import distributions
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
STORE = ROOT / ".armcontour" / "freeze"
PARTS = 2  # processes that share the work of one tree
CHANGED = 200  # drawings with random changes
CHECKED = 400  # trajectories of either sort together
CACHES = 3  # states of the sources whose compiled functions are kept
REFUSED = (2, 3, 4, 5, 6, 8)  # exit codes of errors; the others are answers
RELATIVE = 1e-9  # largest relative difference
METRES = 1e-10  # largest difference of contour errors [m]
# Keys of JSON whose values depend on the machine or the day.
UNSTABLE = re.compile(r"armcontour|version|elapsed|seconds|progress|files|source|made_from")
NAME = re.compile(r"(?:--)?\w(?:[\w-]*\w)?")  # of keys, options, files and their parts
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# A command's results are inputs of later commands in the same group.
OVER = "--x '-100 mm .. 100 mm, 3' --yaw '0 deg .. 90 deg, 2'"
GROUPS = [
    [f"run {{drawings}}/{drawing} --cell {cell} {more} --out out"]
    for drawing, cell, more in [
        *[("gasket.dxf", x, "") for x in ("fr3", "panda", "pmk3s", "ur10e", "ur5e")],
        *[("gasket.dxf", f"{{drawings}}/{x}.yaml", "") for x in ("laser", "gentle")],
        *[("lettering.svg", x, "") for x in ("fr3", "pmk3s", "ur5e")],
        *[("pocket.ngc", "ur5e", ""), ("pocket.ngc", "pmk3s", "--ignore-z")],
        *[("plate.dxf", "ur5e", ""), ("plate.dxf", "panda", "--layer CUT")],
        *[
            ("gasket.dxf", "ur5e", x)
            for x in (
                "--speed '50 mm/s'",
                "--tolerance '0.1 mm'",
                "--layer MARK --corner-shape free --iterations 2 --no-simulation",
                "--continuity curvature",
                "--resume-at '0.45 m'",
                "--layer CUT",
                "--rpy '0, 0, 90 deg' --no-simulation",
                "--position '300 mm, 0 mm, 100 mm'",
                "--position '3 m, 0 m, 0 m'",
                "--scale 0.5",
                "--scale 40",
                "--units inch",
                "--contour nothing",
                "--speed 5",
            )
        ],
    ]
] + [
    ["demo --out out"],
    ["arms"],
    ["schema"],
    ["run {library}/paper.yaml --out out"],
    ["run {library}/plate.yaml --out out"],
    *([f"init {x} --out cell.yaml"] for x in ("fr3", "panda", "pmk3s", "ur10e", "ur5e")),
    *([f"show {{drawings}}/{x} --json"] for x in ("gasket.dxf", "lettering.svg", "pocket.ngc")),
    [f"place {{drawings}}/gasket.dxf --cell ur5e {OVER} --out out"],
    ["certify {library}/paper.yaml --run optimal --servo-error '0.02 mm' --out out"],
    ["certify {library}/paper.yaml --run optimal --servo-error '1 nm' --out out"],
    ["certify {library}/paper.yaml --run optimal --total-tolerance '3 mm' --out out"],
    ["identify {tests}/control/identification/kuka_kr300/A.csv --json --out out"],
    [
        "identify {tests}/control/identification/kuka_kr300/A.csv "
        "--validate {tests}/control/identification/kuka_kr300/B.csv --json"
    ],
    [
        "run {drawings}/gasket.dxf --cell {drawings}/laser.yaml --out out --export csv",
        "export out cut.script",
        "export out cut.src --force",
        "export out cut.mod",
        "export out cut.yaml",
        "export out cut.txt",
        "check out/compensated/planned.csv --arm ur5e --json",
        "check out/compensated/planned.csv --path out/job.yaml --json",
        "check out/compensated/set_points.csv --arm ur5e --scene ur5e --json",
    ],
]


def corpus(folder: Path) -> list[tuple[str, str]]:
    """Write the inputs for both trees; returns names and command lines."""
    from soak.check import _limits, draw
    from soak.readers import mutated
    from soak.samples import samples

    inputs = []
    drawings = sorted((ROOT / "tests" / "files" / "drawings" / "gcode").rglob("*.ngc"))
    texts = [(x.suffix, x.read_bytes()) for x in drawings]
    kinds = (("dxf", ".dxf"), ("svg", ".svg"), ("gcode", ".ngc"), ("csv", ".csv"))
    for seed in range(CHANGED):
        rng = np.random.default_rng(seed)
        kind, ending = kinds[seed % len(kinds)]
        originals = samples(kind)
        texts.append((ending, mutated(originals[int(rng.integers(len(originals)))], rng)))
    for k, (ending, data) in enumerate(texts):
        (folder / f"drawing{k}{ending}").write_bytes(data)
        inputs.append((f"drawing{k}", f"show drawing{k}{ending} --json"))
    for k in range(CHECKED):
        case = draw(k // 2, k % 2 == 0)
        limits = {name: np.ravel(x).tolist() for name, x in _specified(_limits(case))}
        if "speed" in limits:
            limits["speed"] = limits["speed"][0]
        (folder / f"limits{k}.yaml").write_text(json.dumps(limits))
        (folder / f"trajectory{k}.csv").write_text(case.text)
        line = f"check trajectory{k}.csv --arm {case.arm} --limits limits{k}.yaml --json"
        inputs.append((f"trajectory{k}", line))
    return inputs


def _specified(limits: Any) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the limits that are set."""
    for name in ("speed", "joint_velocity", "joint_acceleration", "joint_lower", "joint_upper"):
        if getattr(limits, name) is not None:
            yield name, getattr(limits, name)


def renamed(value: Any, names: Mapping[str, str]) -> Any:
    """Replace names in a record or a command line.

    Args:
        value: The record or the text.
        names: New names by the old ones.
    """
    if isinstance(value, dict):
        return {renamed(key, names): renamed(x, names) for key, x in value.items()}
    if isinstance(value, list):
        return [renamed(x, names) for x in value]
    if isinstance(value, str):
        return NAME.sub(lambda x: names.get(x[0], x[0]), value)
    return value


def record(tree: Path, folder: Path, part: int, names: Mapping[str, str]) -> None:
    """Run one part of the work with the package of this process, and write its record."""
    signal.signal = lambda *_: None  # type: ignore[assignment]
    warnings.simplefilter("ignore")
    folders = {
        "drawings": tree / "examples" / "drawings",
        "library": tree / "src" / "armcontour" / "jobs" / "library",
        "tests": ROOT / "tests",
    }
    records: dict[str, Any] = {}
    work: list[tuple[str, list[str] | Path]] = [
        *((x.name, x) for x in sorted((tree / "examples").glob("*.py"))),
        *((group[0], group) for group in GROUPS),
        *((name, [line]) for name, line in json.loads((folder / "corpus.json").read_text())),
    ]
    for name, item in work[part::PARTS]:
        work_folder = folder / f"work{part}" if item in GROUPS or isinstance(item, Path) else folder
        work_folder.mkdir(exist_ok=True)
        os.chdir(work_folder)
        if isinstance(item, Path):
            records[name] = _run_example(item)
        else:
            for line in item:
                arguments = shlex.split(renamed(line, names).format(**folders))
                records[f"{name}: {line}"] = _run_command(arguments)
        if work_folder != folder:
            records[f"{name}: files"] = {
                str(x.relative_to(work_folder)): read(x)
                for x in sorted(work_folder.rglob("*"))
                if x.is_file()
            }
            os.chdir(folder)
            shutil.rmtree(work_folder)
    (folder / f"part{part}.json").write_text(json.dumps(records, default=str))


def _run_example(file: Path) -> dict[str, Any]:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path(str(file), run_name="__main__")
    return {"numbers": NUMBER.findall(printed.getvalue())}


def _run_command(arguments: list[str]) -> dict[str, Any]:
    """Exit code, printed JSON, and the last error."""
    import armcontour
    from armcontour.cli import main

    raised: list[BaseException] = []
    base = armcontour.ArmContourError
    original = base.__init__  # type: ignore[misc]

    def keep(self: Any, *args: Any, **data: Any) -> None:
        original(self, *args, **data)
        raised[:] = [self]

    printed = io.StringIO()
    sys.argv = ["armcontour", *arguments]
    base.__init__ = keep  # type: ignore[method-assign]
    code: Any = 0
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            main()
    except SystemExit as end:
        code = end.code or 0
    finally:
        base.__init__ = original  # type: ignore[method-assign]
    outcome: dict[str, Any] = {"code": code}
    with contextlib.suppress(ValueError):
        outcome["printed"] = json.loads(printed.getvalue())
    if code in REFUSED and raised:
        data = {k: v for k, v in vars(raised[0]).items() if v is not None}
        outcome["error"] = {"class": type(raised[0]).__name__, "data": data}
    return outcome


def read(file: Path) -> Any:
    """Read a file in a comparable form: JSON unchanged, otherwise sums over columns or numbers."""
    if file.suffix == ".json":
        return json.loads(file.read_text())
    if file.suffix in (".html", ".npz", ".svg"):
        return None
    text = file.read_text(errors="replace")
    if file.suffix == ".csv":
        rows = list(csv.reader(x for x in text.splitlines() if not x.startswith("#")))
        columns = zip(*rows[1:], strict=False)
        return {"rows": len(rows), **dict(zip(rows[0], map(_sums, columns), strict=False))}
    return _sums(NUMBER.findall(text))


def _sums(texts: Any) -> Any:
    """Return the number of values, and their largest and mean magnitude."""
    try:
        values = np.abs(np.array(texts, dtype=float))
    except ValueError:
        return sorted(set(texts))
    return [len(values), *((values.max(), values.mean()) if len(values) else ())]


def differences(old: Any, new: Any, key_path: str = "") -> Iterator[str]:
    """Yield the differences between two records, in words."""
    if UNSTABLE.search(key_path.rpartition("/")[2]):
        return
    old, new = _by_name(old), _by_name(new)
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            if key in old and key in new:
                yield from differences(old[key], new[key], f"{key_path}/{key}")
            else:
                yield f"{key_path}/{key}: only {'before' if key in old else 'now'}"
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, f"{key_path}/{k}")
    elif isinstance(old, (int, float)) and isinstance(new, (int, float)):
        small = METRES if "error" in key_path else 0.0
        if not (old == new or abs(old - new) <= max(RELATIVE * max(abs(old), abs(new)), small)):
            if not (old != old and new != new):
                yield f"{key_path}: {old!r} before, {new!r} now"
    elif old != new and not (_is_sentence(old) and _is_sentence(new)):
        yield f"{key_path}: {str(old)[:80]} before, {str(new)[:80]} now"


def _by_name(value: Any) -> Any:
    """Return rows by name, because their order does not matter, if all names differ."""
    if not isinstance(value, list) or not all(isinstance(x, dict) and "name" in x for x in value):
        return value
    rows = {x["name"]: x for x in value}
    return rows if len(rows) == len(value) else value


def _is_sentence(value: Any) -> bool:
    return isinstance(value, str) and " " in value


def record_of(
    tree: Path, name: str, *, again: bool, names: Mapping[str, str] = MappingProxyType({})
) -> dict[str, Any]:
    """Record of a tree, cached; names in its commands are replaced."""
    file = STORE / f"{name}.json"
    if file.exists() and not again:
        return json.loads(file.read_text())  # type: ignore[no-any-return]
    folder = STORE / "work"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(_stored_corpus(), folder)
    path = os.pathsep.join([str(tree / "src"), str(ROOT)])
    cache = compiled(tree)
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": str(cache)}
    compile_all = [sys.executable, "-m", "armcontour", names.get("compile", "compile")]
    subprocess.check_call(compile_all, env=environment)
    command = [sys.executable, "-m", "tools.freeze", "--record", str(tree), str(folder)]
    running = [
        subprocess.Popen(
            [*command, str(part), json.dumps(dict(names))], cwd=folder, env=environment
        )
        for part in range(PARTS)
    ]
    if any([process.wait() for process in running]):
        sys.exit(f"The work of {tree} could not be recorded.")
    records: dict[str, Any] = {}
    for part in range(PARTS):
        records |= json.loads((folder / f"part{part}.json").read_text())
    file.write_text(json.dumps(records))
    shutil.rmtree(folder)
    return records


def _stored_corpus() -> Path:
    """Return the folder with the inputs of all records, because DXF files have random names."""
    stored = STORE / f"corpus-{_environment()}"
    if not stored.exists():
        begun = STORE / "corpus"
        shutil.rmtree(begun, ignore_errors=True)
        begun.mkdir(parents=True)
        (begun / "corpus.json").write_text(json.dumps(corpus(begun)))
        begun.rename(stored)
    return stored


def compiled(tree: Path) -> Path:
    """Return the folder of a tree's compiled functions; numba misses changes in called ones."""
    state = hashlib.sha256()
    for file in sorted((tree / "src").rglob("*.py")):
        text = file.read_bytes()
        if b"@compiled" in text:
            state.update(text)
    folder = STORE / "cache" / state.hexdigest()[:12]
    folder.mkdir(parents=True, exist_ok=True)
    folder.touch()
    caches = sorted(folder.parent.iterdir(), key=lambda x: x.stat().st_mtime)
    for old in caches[:-CACHES]:
        shutil.rmtree(old)
    return folder


def _environment() -> str:
    """Return a short digest of processor, Python, installed versions and this program."""
    versions = sorted(f"{x.name} {x.version}" for x in distributions() if x.name != "armcontour")
    text = "\n".join([platform.processor(), sys.version, *versions, Path(__file__).read_text()])
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def main() -> int:
    """Compare; returns 1 if there are differences."""
    parser = argparse.ArgumentParser(prog="python -m tools.freeze", description=__doc__)
    parser.add_argument("--against", default="HEAD", help="the earlier commit (default: HEAD)")
    parser.add_argument("--again", action="store_true", help="record that commit again")
    parser.add_argument("--record", nargs=4, help=argparse.SUPPRESS)
    parser.add_argument("--renamed", type=Path, help="file of old and new names, with tabs between")
    options = parser.parse_args()
    if options.record:
        tree, folder, part, names = options.record
        record(Path(tree), Path(folder), int(part), json.loads(names))
        return 0

    def git(*arguments: str) -> str:
        return subprocess.check_output(["git", *arguments], cwd=ROOT, text=True).strip()

    commit = git("rev-parse", f"{options.against}^{{commit}}")
    tree = STORE / "tree"
    git("worktree", "prune")
    if not tree.exists():
        git("worktree", "add", "--detach", str(tree), commit)
    subprocess.check_call(["git", "checkout", "-q", "--detach", "-f", commit], cwd=tree)
    rows = options.renamed.read_text("utf-8").splitlines() if options.renamed else []
    names = dict(x.split("\t") for x in rows if x)
    state = hashlib.sha256("\n".join(rows).encode()).hexdigest()[:6]
    before = {new: old for old, new in names.items()}
    name = f"{commit[:12]}-{_environment()}-{state}"
    old = renamed(record_of(tree, name, again=options.again, names=before), names)
    new = record_of(ROOT, "now", again=True)
    changes = list(differences(old, new))
    print(*changes, sep="\n")
    print(f"{len(old)} results before, {len(new)} now; {len(changes)} differences.")
    return int(bool(changes))


if __name__ == "__main__":
    sys.exit(main())
