"""Measure the benchmark lines, and report which became slower than the baseline."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TypeAlias

from rich.console import Console
from rich.table import Table

from benchmarks import baseline, page
from benchmarks.baseline import Known, Session
from benchmarks.measured import Line, Measured, Missing, in_words, measure

ROOT = Path(__file__).parents[1]
MODULES = (
    *("start_up", "optimal", "torque", "square", "kinematics", "polyline", "projection"),
    *("paper", "certify", "learning", "shaping", "jerk", "recipe", "commands", "batch", "studio"),
)
PACKAGES = (
    *("numpy", "scipy", "numba", "pin"),
    *("toppra", "cmeel-toppra", "roboplan", "copp-py", "casadi"),
)
# One thread in us and in the peers, as the time of the processor counts each.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# A load of each core by others from which the machine is called busy.
BUSY = 0.5
# How often a line that seems slower than the baseline is measured again, at most.
AGAIN = 2
# How often a line is measured for a new baseline, unless `--times` says otherwise.
TIMES = 3
# Measurements of lines by their names.
Found: TypeAlias = dict[str, list[Measured]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; answers 1 if something is slower than the baseline, or failed."""
    options = _parser().parse_args(arguments)
    # It is read when numpy is imported, by the modules.
    for name in THREADS:
        os.environ.setdefault(name, "1")
    everything = all_lines()
    lines = chosen(everything, options.only, options.full)
    if options.list:
        print(*(f"{x.name:32} {x.what}; against {x.peer}" for x in lines), sep="\n")
        return 0
    if options.page:
        _write_pages(everything, options.baseline)
        return 0
    sessions = baseline.read(options.baseline)
    if options.update or options.resume:
        code = _update(options, lines, sessions)
        _write_pages(everything, options.baseline)
        return code
    baselines = baseline.baselines_by_name(sessions)
    measured, failed = _measured(lines, baselines, 1)
    best = [_judged(x) for x in measured.values()]
    print(*baseline.sentences(best, baselines), sep="\n")
    return int(failed or any(baseline.is_slower(x, baselines) for x in best))


def _update(options: argparse.Namespace, lines: list[Line], sessions: Sequence[Session]) -> int:
    """Measure for the baseline, which has every line as soon as it is measured."""
    new = Session(date.today().isoformat(), _commit(), _machine(), {})
    if options.resume:
        there = baseline.done(sessions, new)
        lines = [x for x in lines if x.name not in there]

    def keep(measurements: Found) -> None:
        measured = replace(new, lines={name: Known.of(x) for name, x in measurements.items()})
        baseline.write(options.baseline, baseline.updated(sessions, measured))

    _, failed = _measured(lines, baseline.baselines_by_name(sessions), options.times, keep)
    print(f"Written: {options.baseline}")
    return int(failed)


def _measured(
    lines: Sequence[Line],
    baselines: Mapping[str, Known],
    times: int,
    keep: Callable[[Found], None] | None = None,
) -> tuple[Found, bool]:
    """Measure, and say what was found; answers that, and whether a line failed."""
    busy = _busy()
    begin = time.perf_counter()
    # What goes into the baseline is not judged by the one before.
    measurements, trouble = measure_all(lines, {} if keep else baselines, times, keep)
    best = [_judged(x) for x in measurements.values()]
    _print_table(best, baselines)
    print(*(f"{x.line.name}: {note}." for x in best for note in x.notes), sep="\n")
    minutes = (time.perf_counter() - begin) / 60
    print(f"\n{len(best)} lines in {minutes:.1f} min.", *busy, *trouble, sep="\n")
    return measurements, any(x.startswith("Failed") for x in trouble)


def _write_pages(lines: Sequence[Line], file: Path) -> None:
    """Write the pages that show the baseline of this project; another one has no pages."""
    if file == baseline.FILE:
        print(*(f"Written: {x}" for x in page.write(lines, baseline.read(file))), sep="\n")


def all_lines() -> list[Line]:
    """Return the lines of all modules."""
    return [x for name in MODULES for x in import_module(f"benchmarks.{name}").lines()]


def _is_chosen(line: Line, only: Sequence[str], full: bool) -> bool:
    """Return whether a line has one of the names, or begins with one and is not left out."""
    if line.name in only:
        return True
    return (full or not line.full) and line.name.startswith(tuple(only))


def chosen(lines: Iterable[Line], only: Sequence[str] | None, full: bool) -> list[Line]:
    """Return the lines whose names begin with a given one; the longest only if named."""
    if not only:
        return [x for x in lines if full or not x.full]
    selection = [x for x in lines if _is_chosen(x, only, full)]
    if not selection:
        raise SystemExit(f"No line begins with {' or '.join(only)}: see --list.")
    return selection


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="lines that begin so")
    parser.add_argument("--full", action="store_true", help="the longest lines, too")
    parser.add_argument("--list", action="store_true", help="print the names of the lines")
    parser.add_argument("--update", action="store_true", help="write what is found as the baseline")
    parser.add_argument(
        "--continue",
        dest="resume",
        action="store_true",
        help="--update, without the lines that it has of this commit and machine",
    )
    parser.add_argument(
        "--page", action="store_true", help="only write the pages that show the baseline"
    )
    parser.add_argument("--times", type=int, default=TIMES, help="so often for it, by default 3")
    parser.add_argument("--baseline", type=Path, default=baseline.FILE, help="its file")
    return parser


def measure_all(
    lines: Sequence[Line],
    baselines: Mapping[str, Known],
    times: int,
    keep: Callable[[Found], None] | None = None,
) -> tuple[Found, list[str]]:
    """Return all measurements by name, and sentences on lines without any.

    Args:
        lines: What is measured.
        baselines: The baseline with which lines are compared.
        times: How often each line is measured.
        keep: Called with all that was measured so far, after each line.
    """
    measurements: Found = {}
    trouble: list[str] = []
    for k, line in enumerate(lines):
        print(f"{k + 1}/{len(lines)} {line.name}", end=": ", flush=True)
        try:
            measurements[line.name] = measure(line, times)
        except KeyboardInterrupt:
            # What was measured until then counts.
            print("interrupted", flush=True)
            return measurements, [
                *trouble,
                f"Interrupted: {len(lines) - k} lines are not measured.",
            ]
        except Missing as reason:
            print("left out", flush=True)
            trouble.append(f"Left out: {line.name}, as {reason}.")
        except Exception as error:
            print("failed", flush=True)
            trouble.append(f"Failed: {line.name}: {type(error).__name__}: {error}")
        else:
            _print_row(measurements[line.name][-1], baselines)
            if keep is not None:
                keep(measurements)
    # Noise is not blamed on a line: it is slower only if it is so whenever it is measured.
    for _ in range(AGAIN):
        for line in lines:
            mine = measurements.get(line.name, [])
            if mine and all(baseline.is_slower(x, baselines) for x in mine):
                print(f"{line.name} seems slower, once more", end=": ", flush=True)
                mine += measure(line)
                _print_row(mine[-1], baselines)
    return measurements, trouble


def _judged(repetitions: Sequence[Measured]) -> Measured:
    """Return the measurement with the lowest ratio."""
    return min(repetitions, key=lambda x: x.ratio)


def _print_row(x: Measured, baselines: Mapping[str, Known]) -> None:
    change = baseline.change(x, baselines)
    more = "" if change is None else f", {change:+.0%}"
    took = in_words(x.least[0])
    print(f"{took}, {x.ratio:.3g} of {x.line.peer}{more}", flush=True)


def _print_table(rows: Iterable[Measured], baselines: Mapping[str, Known]) -> None:
    table = Table(title="armcontour benchmarks", title_justify="left")
    heads = ("line", "what", "ours", "peer", "peer's", "ratio", "baseline", "change", "bar")
    for name in heads:
        right = name in ("ours", "peer's", "ratio", "baseline", "change")
        table.add_column(name, justify="right" if right else "left")
    for x in rows:
        change = baseline.change(x, baselines)
        ours, peer = (in_words(x) for x in x.least)
        table.add_row(
            *(x.line.name, x.line.what, ours, x.line.peer, peer),
            f"{x.ratio:.3g}",
            "-" if change is None else f"{baselines[x.line.name].ratio:.3g}",
            "-" if change is None else f"{change:+.0%}",
            "-" if x.of_bar == "-" else f"{x.of_bar} of {x.line.bar}",
        )
    Console(width=200).print(table)


def _busy() -> list[str]:
    """Return a sentence if other programs kept the machine busy in the last minute."""
    cores = os.cpu_count() or 1
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    if load < BUSY * cores:
        return []
    return [
        f"The machine was busy with other work, a load of {load:.1f} on {cores} cores: times by "
        "the clock are too long, and ratios are less sure."
    ]


def _commit() -> str:
    """Return the commit, and whether files differ from it that a measurement does not write."""
    written = (f":(exclude){x.relative_to(ROOT)}" for x in (baseline.FILE, *page.FILES))
    try:
        commit = _git("rev-parse", "--short", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", ".", *written)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{commit}-dirty" if changed else commit


def _git(*words: str) -> str:
    call = ["git", "-C", str(ROOT), *words]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()


def _machine() -> str:
    """Return processor, cores, and the versions on which the times depend."""
    cpus = Path("/proc/cpuinfo")
    names = cpus.read_text().splitlines() if cpus.exists() else []
    name = next((x.split(":")[1].strip() for x in names if x.startswith("model name")), None)
    parts = [name or platform.processor() or platform.machine(), f"{os.cpu_count()} cores"]
    parts.append(f"Python {platform.python_version()}")
    for package in PACKAGES:
        try:
            parts.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    return ", ".join(parts)


if __name__ == "__main__":
    sys.exit(main())
