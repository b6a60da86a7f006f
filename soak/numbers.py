"""`python -m soak.numbers`: put what breaks programs into every number of jobs and options.

What the command line may do with it is a result, or one sentence; within ten seconds of computing
and little memory, without a traceback, a warning of a library, or a number in a result that is
none. Exit code 1 if it does anything else.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import yaml

from soak.number_cases import FILES, HOSTILE, PLANE, base_of, fields, numeric_options, put, shown

# A number is not worth more [s of computing], [bytes]. The wall clock may take so many times longer
# on a machine with other work.
LONGEST = 10
LARGEST = 2e9
PATIENCE = 30.0
# How often memory is looked at [s].
LOOK = 0.01
GOOD = ("done", "refused")
NOT_A_NUMBER = re.compile(r"(?<![\w.])[-+]?(nan|NaN|inf|Infinity)(?![\w.])")


@dataclass(frozen=True, slots=True)
class Case:
    """One call of the command line.

    Args:
        name: What is put where.
        job: The job file's text.
        arguments: Of the command line; {job}, {log} and {out} stand for files of the case.
    """

    name: str
    job: str
    arguments: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a case: its kind, seconds of computing, bytes, and what was said."""

    case: Case
    kind: str
    seconds: float
    memory: float
    note: str


# The command that a key of the job is for, if that is not every one.
COMMANDS = {"certificate": "certify", "placement": "place"}


def cases(only: str = "") -> Iterator[Case]:
    """All of them whose name matches the expression `only`."""
    for case in (*_of_jobs(), *_of_options()):
        if re.search(only, case.name):
            yield case


def _of_jobs() -> Iterator[Case]:
    for place in fields():
        base = base_of(place)
        command = COMMANDS.get(str(place[0]), "run")
        for word, value in HOSTILE.items():
            yield Case(
                f"{shown(place)} = {word}",
                yaml.safe_dump(put(base, place, value)),
                (command, "{job}", "--out", "{out}"),
            )


# Learning is from one run of a simulated robot, or else from a file.
OF_FILES = ("--taught", "{log}", "--log", "{log}")
BESIDE = {
    ("place", "--over"): (),
    ("learn", "--from"): OF_FILES,
    ("learn", "--to"): OF_FILES,
    ("learn", "--simulate"): (),
}
BESIDE_ALL = {
    "learn": ("--simulate", "1"),
    "place": ("--over", "x: 0 mm .. 1 mm, 2"),
}


def _of_options() -> Iterator[Case]:
    text = yaml.safe_dump(PLANE | {"certificate": {"tolerance": 2e-3, "servo": 1e-4}})
    for command, option, form in numeric_options():
        source = {"identify": "{log}", "batch": "{plan}"}.get(command, "{job}")
        for word, value in HOSTILE.items():
            number = str(value) if isinstance(value, str) else f"{value:g}"
            given = form.replace("#", number)
            beside = BESIDE.get((command, option), BESIDE_ALL.get(command, ()))
            call = (command, source, f"{option}={given}", *beside, "--out", "{out}")
            yield Case(f"{command} {option} '{given}' ({word})", text, call)


def log_text() -> str:
    """A short log of one joint that steps to and fro."""
    t = np.arange(400) * 4e-3
    command = 0.1 * np.sin(7 * t) * np.sin(3 * t)
    measured = np.interp(t - 0.05, t, command)
    rows = "".join(
        f"{a:.4f},{b:.9f},{c:.9f}\n" for a, b, c in zip(t, command, measured, strict=True)
    )
    return "t,command1,measured1\n" + rows


def tried(case: Case) -> Outcome:
    """The outcome of a case, in a process of its own."""
    folder = FilePath(tempfile.mkdtemp(prefix="numbers-"))
    try:
        for name, data in FILES.items():
            (folder / name).write_bytes(data)
        (folder / "job.yaml").write_text(case.job)
        (folder / "log.csv").write_text(log_text())
        places = {x: str(folder / y) for x, y in
                  (("{job}", "job.yaml"), ("{log}", "log.csv"), ("{plan}", "plan.yaml"),
                   ("{out}", "out"))}  # fmt: skip
        arguments = [places.get(x, x) for x in case.arguments]
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            _call(arguments, folder)
        status, seconds, memory, ended = _watched(child)
        said = (folder / "said").read_text(errors="replace")
        kind = ended or _judged(status, said, folder / "out")
        return Outcome(case, kind, seconds, memory, said[-2000:])
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _call(arguments: list[str], folder: FilePath) -> None:
    """Be the command line; it never comes back."""
    code = 70
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST, LONGEST + 1))
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        said = os.open(folder / "said", os.O_WRONLY | os.O_CREAT)
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.argv = ["armcontour", *arguments]
        from armcontour.cli import main

        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except BaseException:
            import traceback

            traceback.print_exc()
            code = 70
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _watched(child: int) -> tuple[int, float, float, str]:
    """Status, seconds of computing, largest memory [bytes] of a child, and what ended it if we."""
    begin, most, ended = time.monotonic(), 0.0, ""
    while True:
        done, status, used = os.wait4(child, os.WNOHANG)
        if done:
            if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU:
                ended = "hang"
            return status, used.ru_utime + used.ru_stime, max(most, used.ru_maxrss * 1024.0), ended
        try:
            pages = FilePath(f"/proc/{child}/statm").read_text().split()[1]
            most = max(most, int(pages) * resource.getpagesize())
        except (OSError, IndexError):
            pass
        if not ended and (most > LARGEST or time.monotonic() - begin > PATIENCE * LONGEST):
            ended = "memory" if most > LARGEST else "hang"
            os.kill(child, signal.SIGKILL)
        time.sleep(LOOK)


def _judged(status: int, said: str, out: FilePath) -> str:
    """What kind of end that was."""
    if "Traceback" in said or not os.WIFEXITED(status):
        return "traceback"
    if "Warning: " in said and re.search(r"\w+Warning: ", said):
        return "warning"
    code = os.WEXITSTATUS(status)
    if code > 1:
        # What typer refuses itself has its usage before the sentence.
        lines = [x for x in said.splitlines() if x.strip()]
        sentence = len(lines) == 1 and lines[0].startswith("Error: ")
        return "refused" if sentence or lines[:1] and lines[0].startswith("Usage:") else "wordy"
    if re.search(r"(?<![\w.])(nan|inf)(?![\w.])", said):
        return "not a number"
    for file in out.rglob("*") if out.exists() else ():
        if file.suffix in (".csv", ".json", ".yaml") and NOT_A_NUMBER.search(file.read_text()):
            return "not a number"
    return "done"


def warm() -> None:
    """Compile and load what cases need, so that each is timed by itself."""
    from armcontour.cli import main  # noqa: F401

    tempfile.tempdir = None
    seen: set[str] = set()
    for place in fields():
        text = yaml.safe_dump(base_of(place))
        if text not in seen:
            seen.add(text)
            command = next((x for key, x in COMMANDS.items() if f"{key}:" in text), "run")
            _warmed(Case(shown(place), text, (command, "{job}", "--out", "{out}")))


def _warmed(case: Case) -> None:
    """Run a case here, unseen."""
    from typer.testing import CliRunner

    from armcontour.cli.commands import app

    with tempfile.TemporaryDirectory() as name:
        folder = FilePath(name)
        for file, data in FILES.items():
            (folder / file).write_bytes(data)
        (folder / "job.yaml").write_text(case.job)
        arguments = [
            {"{job}": str(folder / "job.yaml"), "{out}": str(folder / "out")}.get(x, x)
            for x in case.arguments
        ]
        found = CliRunner().invoke(app, arguments)
        if found.exit_code and found.exception is not None:
            print(f"base {case.name}: {found.exception}")


def main() -> None:
    """Try all cases, print how many ended how, and those that ended badly."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="cases whose name matches this expression")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--all", action="store_true", help="print what came of every case")
    options = parser.parse_args()
    chosen = list(cases(options.only))
    warm()
    counts: Counter[str] = Counter()
    import multiprocessing

    # Workers are copies of this process, and so warm.
    fork = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(options.workers, mp_context=fork) as pool:
        for x in pool.map(tried, chosen, chunksize=1):
            counts[x.kind] += 1
            if options.all or x.kind not in GOOD:
                lines = x.note.strip().splitlines() or [""]
                note = (
                    lines[-1]
                    if x.kind != "warning"
                    else " ".join(y for y in lines if re.search(r"\w+Warning: ", y))
                )
                print(f"{x.kind}: {x.case.name} ({x.seconds:.1f} s, {x.memory / 1e6:.0f} MB) "
                      f"{note[:300]}", flush=True)  # fmt: skip
    print(json.dumps(dict(counts)), f"of {len(chosen)}")
    sys.exit(any(counts[x] for x in counts if x not in GOOD))


if __name__ == "__main__":
    main()
