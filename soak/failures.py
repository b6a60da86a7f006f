"""Halt or kill processes while `armcontour play` moves joints of a HAL file.

A second sampler, which armcontour does not know, records the commands and whether the drives are
enabled. Each trial needs its own HAL, separate from that of the machine, so it runs as root
(`unshare`).

The seed modulo 35 selects the processes and what happens to them; the seed divided by 35 selects
one of 12 moments. `python -m soak failures --jobs 2 --count 420` tries all.
"""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

import armcontour as ac
from soak import Outcome

HAL_FILE = FilePath(__file__).parents[1] / "examples" / "linuxcnc" / "machine.hal"
JOB = """
name: line
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.350, 0.200]]}
corners: {tolerance: 5 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {cycle: 1 ms, compensation: {method: none}}}
"""
# Joint acceleration limit of this arm [rad/s²], which stops use at every speed factor.
LIMIT = 0.72
# Number of cycles in the motion without its rest.
CYCLES = 5400
MOMENTS = 12
DURATIONS = (0.1, 0.2, 0.5, 1.0, 2.0)
TARGETS = ("guard", "child", "feeder", "player", "rtapi")
# Names of the processes that are halted for a duration [s], or killed (None).
CASES: list[tuple[str, float | None]] = [(x, d) for x in TARGETS for d in DURATIONS]
CASES += [(x, None) for x in (*TARGETS, "feeder and player", "guard, then child")]
CASES += [("disk", None), ("disk of the log", None), ("nothing", None)]
# Number of attempts per trial on a machine that is too busy.
ATTEMPTS = 4
# Longest time of a trial [s].
PATIENCE = 90.0
# Units of own samples in a rad: halsampler prints six digits after the point.
MICRO = 1e6


def own_hal_file(samples: FilePath) -> str:
    """Return the HAL file of the documentation with a second sampler."""
    text = HAL_FILE.read_text(encoding="utf-8")
    text = text.replace("depth=8000 cfg=fffff", "depth=8000,120000 cfg=fffff,fffffb")
    names = [f"own-{x}" for x in range(4)]
    text = text.replace("loadrt scale names=", f"loadrt scale names={','.join(names)},")
    signals = ("joint-1", "joint-2", "measured-1", "measured-2")
    for k, (name, source) in enumerate(zip(names, signals, strict=True)):
        text += f"setp {name}.gain {MICRO:.0f}\nnet {source} => {name}.in\n"
        text += f"net {name} {name}.out => sampler.1.pin.{k + 1}\naddf {name} servo\n"
    text += "net cycle => sampler.1.pin.0\nnet armcontour-enable => sampler.1.pin.5\n"
    return text + f"addf sampler.1 servo\nloadusr halsampler -c 1 -t {samples}\n"


class CameLate(Exception):
    """This machine was too busy, and a motion was stopped before the trial."""


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Samples of the second sampler.

    Args:
        number: Cycle numbers of the thread, (n,).
        k: Cycles of the motion, (n,).
        command: Commands of the joints [rad], (n, 2).
        enabled: Whether the drives were enabled, (n,).
    """

    number: np.ndarray
    k: np.ndarray
    command: np.ndarray
    enabled: np.ndarray

    def acceleration(self) -> float:
        """Return the largest commanded acceleration while the drives were enabled [rad/s²]."""
        whole = (np.diff(self.number, 2) == 0) & self.enabled[2:] & self.enabled[:-2]
        values = np.abs(np.diff(self.command, 2, axis=0)).max(axis=1) * 1e6
        return float(values[whole].max(initial=0.0))

    def speed(self) -> float:
        """Return the largest commanded speed in the last enabled samples [rad/s]."""
        command = self.command[self.enabled][-20:]
        return float(np.abs(np.diff(command, axis=0)).max(initial=0.0)) * 1e3


def read_samples(file: FilePath) -> Samples:
    """Read the samples that `halsampler` has written."""
    rows = []
    for line in file.read_text(errors="replace").splitlines()[:-1]:
        words = line.split()
        if len(words) == 7 and words[0] != "overrun":
            rows.append([float(x) for x in words])
    table = np.array(rows).reshape(-1, 7)
    return Samples(
        number=table[:, 0],
        k=table[:, 1],
        command=table[:, 2:4] / MICRO,
        enabled=table[:, 6] > 0,
    )


def process_table() -> list[tuple[int, int, str]]:
    """List the number, parent number and command line of each process."""
    found = []
    for entry in FilePath("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (OSError, IndexError):
            # The process has ended.
            continue
        found.append((int(entry.name), parent, words))
    return found


class Trial:
    """One motion on a HAL file, played by the command line on a terminal."""

    def __init__(self, target: str, duration: float | None, moment: int) -> None:
        self.target = target
        self.duration = duration
        self.moment = moment
        # The folder of results may be on a small disk of its own.
        self.folder = FilePath(tempfile.mkdtemp(prefix="failing-"))
        self.folder.chmod(0o711)
        self.samples = self.folder / "own.txt"
        self.out = self.folder / "out"
        (self.folder / "job.yaml").write_text(JOB, encoding="utf-8")
        (self.folder / "machine.hal").write_text(own_hal_file(self.samples), encoding="utf-8")
        self.printed = b""
        self.happened = False
        # Whether the motion has begun.
        self.begun = False

    def run(self) -> tuple[int, list[str], float]:
        """Play, do what the case says, and judge; exit code, notes, and ratio of acceleration."""
        if "disk" in self.target:
            self.out.mkdir()
            # With 1500 kB, the record fits but the log does not.
            size = "size=1500k" if self.target == "disk of the log" else "size=6M"
            subprocess.run(["mount", "-t", "tmpfs", "-o", size, "own", self.out], check=True)
            self.out = self.out / "out"
        words = [sys.executable, "-m", "armcontour", "play", "job.yaml", "--on", "linuxcnc"]
        words += ["--hal", "machine.hal", "--speed-factor", "50 %", "--execute"]
        pid, terminal = pty.fork()
        if not pid:
            os.chdir(self.folder)
            os.environ["TMPDIR"] = str(self.folder)
            os.execv(sys.executable, [*words, "--out", str(self.out)])
        self.player = pid
        reader = threading.Thread(target=self._read, args=(terminal,), daemon=True)
        reader.start()
        try:
            self._wait(lambda: b"to continue" in self.printed)
            os.write(terminal, b"PMK-3s\n")
            self._wait(lambda: self._cycle() >= (self.moment + 0.5) / MOMENTS * CYCLES)
            self.act()
            self.happened = True
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            self._wait(lambda: self._is_over())
            time.sleep(0.3)
            return code, *self.judge(code)
        finally:
            os.close(terminal)
            self.close()

    def act(self) -> None:
        """Halt or kill the processes of this case."""
        if self.target == "disk":
            # The rest of the disk is filled.
            with open(self.out / "other", "wb", buffering=0) as file:
                try:
                    while True:
                        file.write(b"x" * 4096)
                except OSError:
                    pass
        elif self.target == "guard, then child":
            first, second = self.feeders()
            os.kill(first, signal.SIGKILL)
            time.sleep(0.02)
            os.kill(second, signal.SIGKILL)
        elif self.target not in ("nothing", "disk of the log"):
            targets = self.targets()
            for pid in targets:
                os.kill(pid, signal.SIGKILL if self.duration is None else signal.SIGSTOP)
            if self.duration is not None:
                time.sleep(self.duration)
                for pid in targets:
                    # The guard may have killed its child.
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGCONT)

    def targets(self) -> list[int]:
        """Return the processes of this case."""
        found = []
        if self.target in ("guard", "feeder", "feeder and player"):
            found += self.feeders()[:1]
        if self.target in ("child", "feeder", "feeder and player"):
            found += self.feeders()[1:]
        if self.target in ("player", "feeder and player"):
            found.append(self.player)
        return found + (self.programs() if self.target == "rtapi" else [])

    def feeders(self) -> list[int]:
        """Return the guard and its child; fewer if they have ended."""
        found = []
        for pid, _, words in process_table():
            if "linuxcnc_feeder" in words and str(self.folder) in words:
                found.append(pid)
        return sorted(found)

    def programs(self, name: str = "rtapi_app") -> list[int]:
        """Return the LinuxCNC processes of this trial."""
        found = []
        for pid, _, words in process_table():
            try:
                environment = FilePath(f"/proc/{pid}/environ").read_bytes()
            except OSError:
                continue
            if name in words and str(self.folder).encode() in environment:
                found.append(pid)
        return found

    def judge(self, code: int) -> tuple[list[str], float]:
        """Return what is wrong, and the largest commanded acceleration divided by the limit."""
        samples = read_samples(self.samples)
        notes = []
        lost = re.findall(r"Error: [^\r]*", self.text())
        ratio = samples.acceleration() / LIMIT
        if ratio > 1:
            notes.append(f"acceleration {ratio:.6f} of the limit")
        if self.target != "rtapi" and samples.enabled[-1]:
            notes.append("drives are enabled in the last sample")
        if self.target != "rtapi" and samples.speed() > 1e-9:
            notes.append(f"drives were disabled at {samples.speed():.3g} rad/s")
        shown = subprocess.run(
            ["halcmd", "-s", "show", "sig", "armcontour-enable"], capture_output=True, text=True
        )
        if "TRUE" in shown.stdout:
            notes.append("armcontour-enable is true afterwards")
        expected = self.expected_codes()
        if code not in expected:
            notes.append(f"exit code {code}, not in {expected}: {self.printed[-300:]!r}")
        notes += self.judge_log(samples)
        return notes + lost if notes else [], ratio

    def expected_codes(self) -> tuple[int, ...]:
        """Exit codes of this case."""
        if b"not ready in time" in self.printed:
            # This machine is too busy.
            return (0, 1, 11)
        if self.target == "nothing":
            return (0,)
        if self.duration is None and "player" in self.target:
            return (-signal.SIGKILL,)
        if self.duration is None and self.target in ("feeder", "rtapi", "guard, then child"):
            return (11,)
        if "disk" in self.target:
            return (1, 2)
        # A halt may be too short to be noticed, and a guard may be replaced by the child.
        return (0, 1, 11)

    def judge_log(self, samples: Samples) -> list[str]:
        """List what is wrong with the log."""
        places = [self.out / "log.csv", self.out / "unfinished.csv"]
        places += [FilePath(x) for x in re.findall(r"/\S+/log\.csv", self.text())]
        logs = [x for x in places if x.exists()]
        if not logs:
            return [f"no log: {self.text()[-300:]!r}"]
        log = ac.read_log(logs[0])
        wanted = (self.moment + 0.5) / MOMENTS * CYCLES * 1e-3 - 0.2
        notes = []
        if np.ptp(log.t) < wanted:
            notes.append(f"{logs[0].name} has {np.ptp(log.t):.3f} s of {wanted:.3f} s")
        summary = self.out / "summary.json"
        if summary.exists() and self.duration is None and self.target != "nothing":
            data = json.loads(summary.read_text())
            if data["completed"]:
                notes.append("the summary says that the motion was played to its end")
        return notes

    def text(self) -> str:
        """Return what the command printed, without the line breaks of the terminal."""
        return self.printed.decode(errors="replace").replace("\r\n", " ")

    def close(self) -> None:
        """End all processes of this trial, and remove its folder."""
        for pid in (*self.programs(""), *self.feeders()):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        if "disk" in self.target:
            subprocess.run(["umount", "-l", self.folder / "out"], check=False)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _is_over(self) -> bool:
        """Return whether feeders have ended, and no drive is enabled."""
        if self.feeders():
            return False
        if not self.programs():
            return True
        return not read_samples(self.samples).enabled[-1]

    def _cycle(self) -> float:
        """Return the cycle of the motion in the last sample; -1 without one."""
        try:
            with open(self.samples, "rb") as file:
                file.seek(max(self.samples.stat().st_size - 1000, 0))
                lines = file.read().decode(errors="replace").splitlines()[1:-1]
        except OSError:
            return -1.0
        k = float(lines[-1].split()[1]) if lines and b"playing" in self.printed else -1.0
        # The last samples may be of the motion to the start.
        self.begun = self.begun or 0 <= k < CYCLES / MOMENTS / 2
        return k if self.begun else -1.0

    def _read(self, terminal: int) -> None:
        try:
            while data := os.read(terminal, 4096):
                self.printed += data
        except OSError:
            return

    def _wait(self, done: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not done():
            if b"not ready in time" in self.printed and not self.happened:
                raise CameLate
            if time.monotonic() > end:
                raise TimeoutError(f"It did not happen: {self.text()[-400:]!r}")
            time.sleep(0.005)


def run(seed: int) -> Outcome:
    """Judge the case of a seed, in a HAL apart from that of the machine."""
    if shutil.which("halcmd") is None or os.geteuid():
        return Outcome(kind="LinuxCNC", result="not installed, or not root")
    words = ["unshare", "--ipc", "--mount", sys.executable, "-m", "soak.failures", str(seed)]
    done = subprocess.run(words, capture_output=True, text=True)
    target, duration = CASES[seed % len(CASES)]
    kind = f"{target} {'killed' if duration is None else f'halted {duration:g} s'}"
    if done.returncode:
        return Outcome(kind=kind, result="crash", notes=[done.stderr[-600:]])
    data = json.loads(done.stdout.splitlines()[-1])
    return Outcome(
        kind=kind, result=f"exit code {data['code']}", notes=data["notes"], worst=data["ratio"]
    )


def main(seed: int) -> None:
    """Run one trial, and print its exit code, notes and ratio as JSON."""
    number, case = divmod(seed, len(CASES))
    for _ in range(ATTEMPTS):
        try:
            code, notes, ratio = Trial(*CASES[case], number % MOMENTS).run()
            break
        except CameLate:
            continue
    else:
        code = 0
        ratio = 0.0
        notes = ["this machine is too busy"]
    print(json.dumps({"code": code, "notes": notes, "ratio": ratio}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
