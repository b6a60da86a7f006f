"""Send signals, kills and races at random moments of every command.

After a signal, a command must end within a second and leave the old result, the new result or none,
and nothing else. After `kill -9`, the same command must succeed, unless files were being renamed;
it then names the folder of the earlier result. If two runs start at once into one folder, one
succeeds and the other one is refused.
"""

from __future__ import annotations

import atexit
import hashlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path as FilePath

from tests.corner_job import CORNER_JOB

from soak import Outcome

COMMANDS = {
    "run": ["run", "job.yaml", "--out", "out"],
    "demo": ["demo", "--out", "out"],
    "check": ["check", "planned.csv", "--path", "job.yaml"],
    "certify": ["certify", "job.yaml", "--out", "out"],
    "place": ["place", "job.yaml", "--out", "out", "--x", "-20 mm .. 20 mm, 9"],
    "identify": ["identify", "log.csv", "--out", "out"],
    "learn": ["learn", "job.yaml", "--set-points", "first", "--log", "log.csv", "--out", "out"],
    "export": [
        *("run", "job.yaml", "--out", "out", "--no-simulation"),
        *("--export", "csv", "--export", "ros-yaml"),
    ],
}
# A signal is answered within this [s].
BAR = 1.0


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, what it said, and how long it took after a signal."""

    code: int
    said: str
    after: float


def begin(folder: FilePath, arguments: list[str]) -> subprocess.Popen[str]:
    """Start a command."""

    def listen() -> None:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)

    return subprocess.Popen(
        [sys.executable, "-m", "armcontour", *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=listen,
    )


def call(
    folder: FilePath, arguments: list[str], number: int | None = None, wait: float = 0.0
) -> Ended:
    """Run a command; after `wait` seconds it gets a signal, if there is one."""
    with begin(folder, arguments) as process:
        if number is not None:
            try:
                process.wait(wait)
            except subprocess.TimeoutExpired:
                process.send_signal(number)
        sent = time.monotonic()
        _, errors = process.communicate(timeout=600)
        return Ended(process.returncode, errors, time.monotonic() - sent)


def state(folder: FilePath) -> dict[str, str]:
    """Return all files below a folder, with their checksums."""
    return {
        str(x.relative_to(folder)): hashlib.sha256(x.read_bytes()).hexdigest()
        for x in sorted(folder.rglob("*"))
        if x.is_file() and "__pycache__" not in x.parts
    }


def result(files: dict[str, str]) -> dict[str, str]:
    """Return the files of the result, without those that differ from run to run."""
    return {x: y for x, y in files.items() if x.startswith("out/")}


class Bench:
    """A folder with a job and its inputs, in which commands are tried."""

    def __init__(self, root: FilePath) -> None:
        self.root = root
        self.folder = root / "work"
        self.folder.mkdir()
        (self.folder / "job.yaml").write_text(CORNER_JOB, encoding="utf-8")
        first = call(self.folder, COMMANDS["run"])
        assert first.code == 0, first.said
        shutil.copy(self.folder / "out/only/planned.csv", self.folder / "planned.csv")
        shutil.copytree(self.folder / "out", self.folder / "first")
        self._write_log()
        shutil.rmtree(self.folder / "out")
        self.inputs = state(self.folder)
        self.whole: dict[str, dict[str, str]] = {}
        self.durations: dict[str, float] = {}
        self.codes: dict[str, int] = {}
        for name, arguments in COMMANDS.items():
            call(self.folder, arguments)
            shutil.rmtree(self.folder / "out", ignore_errors=True)
            begun = time.monotonic()
            ended = call(self.folder, arguments)
            self.durations[name] = time.monotonic() - begun
            assert ended.code in (0, 1, 7, 9) and "Traceback" not in ended.said, (name, ended.said)
            self.codes[name] = ended.code
            self.whole[name] = result(state(self.folder))
            if self.whole[name]:
                shutil.copytree(self.folder / "out", root / name)
            shutil.rmtree(self.folder / "out", ignore_errors=True)

    def _write_log(self) -> None:
        """Write a log of the run: its set-points, and a servo's response."""
        import numpy as np

        from armcontour.files import read_job
        from armcontour.jobs import run
        from armcontour.simulation import ServoPlant, simulate

        job = read_job(self.folder / "job.yaml")
        plan = run(job, simulate=False).runs["only"]
        plant = ServoPlant(job.arm, job.servo)
        execution = simulate(plan.set_points, plant)
        commands = np.column_stack(
            [
                np.interp(execution.t, plan.set_points.t, plan.set_points.q[:, k])
                for k in range(job.arm.dof)
            ]
        )
        table = np.column_stack([execution.t, commands, execution.q])
        np.savetxt(self.folder / "log.csv", table, "%.9f", ",", header="t,u1,u2,q1,q2", comments="")

    def prepare(self, name: str, earlier: bool) -> list[str]:
        """Put an earlier result there, or none; gives the command."""
        shutil.rmtree(self.folder / "out", ignore_errors=True)
        if not earlier or not self.whole[name]:
            return COMMANDS[name]
        shutil.copytree(self.root / name, self.folder / "out")
        return [*COMMANDS[name], "--force"]

    def wrong(self, name: str, earlier: bool) -> str:
        """Return what is wrong with the result; empty if it is the old or new one, or missing."""
        contents = state(self.folder)
        others = {x: y for x, y in contents.items() if x not in result(contents)}
        if others != self.inputs:
            return f"left: {sorted(set(others) ^ set(self.inputs))}"
        present = set(result(contents))
        allowed = [set(self.whole[name])] + ([] if earlier else [set()])
        if present not in allowed:
            return f"neither whole nor none: {sorted(present ^ set(self.whole[name]))}"
        folders = [str(x) for x in self.folder.rglob(".armcontour-*")]
        if folders or (not present and (self.folder / "out").exists()):
            return f"left: {folders or 'an empty folder'}"
        return ""


def try_signal(bench: Bench, draw: random.Random) -> list[str]:
    """Send a signal at a random moment."""
    name = draw.choice(list(COMMANDS))
    number = draw.choice([signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
    earlier = draw.random() < 0.5
    arguments = bench.prepare(name, earlier)
    ended = call(bench.folder, arguments, number, draw.uniform(0.0, 1.05 * bench.durations[name]))
    notes = [bench.wrong(name, earlier)]
    # Python's own start-up, before any line of this program, ends by the signal itself.
    if ended.code not in (bench.codes[name], 128 + number, -number):
        notes.append(f"exit code {ended.code}: {ended.said}")
    # Once this program listens, no signal raises KeyboardInterrupt.
    if "Traceback" in ended.said and "KeyboardInterrupt" not in ended.said:
        notes.append(f"a traceback: {ended.said[-300:]}")
    if ended.after > BAR:
        notes.append(f"ended {ended.after:.2f} s after the signal")
    return [f"{name}, {number.name}, {earlier=}: {x}" for x in notes if x]


def try_kill(bench: Bench, draw: random.Random) -> list[str]:
    """Send `kill -9`, then run the same command without and with --force."""
    name = draw.choice([x for x in COMMANDS if bench.whole[x]])
    earlier = draw.random() < 0.5
    arguments = bench.prepare(name, earlier)
    wait = draw.uniform(0.2, 1.0) * bench.durations[name]
    call(bench.folder, arguments, signal.SIGKILL, wait)
    if any(bench.folder.glob("out/.armcontour-next/.old/*")):
        return []
    plain = call(bench.folder, COMMANDS[name])
    notes = [] if plain.code in (0, 2) else [f"without --force: {plain.code} {plain.said}"]
    notes.append(bench.wrong(name, earlier))
    forced = call(bench.folder, [*COMMANDS[name], "--force"])
    if forced.code:
        notes.append(f"with --force: {forced.code} {forced.said}")
    notes.append(bench.wrong(name, earlier=True))
    return [f"{name}, {earlier=}: {x}" for x in notes if x]


def try_race(bench: Bench, draw: random.Random) -> list[str]:
    """Start two runs at once into one folder."""
    name = draw.choice(["run", "export", "demo"])
    earlier = draw.random() < 0.5
    arguments = bench.prepare(name, earlier=earlier)
    first = begin(bench.folder, arguments)
    time.sleep(draw.uniform(0.0, 0.2))
    second = begin(bench.folder, arguments)
    errors = [x.communicate(timeout=600)[1] for x in (first, second)]
    codes = sorted((first.returncode, second.returncode))
    notes = [bench.wrong(name, earlier=True)]
    # Where a folder may be replaced, the second run may come after the first.
    if codes != [0, 2] and not (earlier and codes == [0, 0]):
        notes.append(f"exit codes {codes}: {errors}")
    return [f"{name}: {x}" for x in notes if x]


@cache
def own_bench() -> Bench:
    """Return the folder of this process."""
    root = tempfile.mkdtemp(prefix="interrupts-")
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return Bench(FilePath(root))


def run(seed: int) -> Outcome:
    """Try six signals for each kill and race."""
    act = (try_kill, try_race, *[try_signal] * 6)[seed % 8]
    notes = act(own_bench(), random.Random(seed))
    return Outcome(kind=act.__name__, result="ended", notes=notes)
