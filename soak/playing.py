"""Motions on LinuxCNC with stops and failures at random times, judged independently.

Each motion is the paper's job with inverse compensation, on simulated drives in a HAL of its own.
Its override changes at random times, with pauses; that of Ctrl-C is 100 %.
The tool is calculated from the joints by formulas, its distance from the path by lines and arcs,
and the demanded acceleration by HAL's law from the record. One process is best: `--jobs 1`.

| seed modulo 10 | what happens |
|---|---|
| 0 to 3 | a stop is requested |
| 4 | the player is killed; the record is that of the feeder |
| 5 | the pipe to the feeder is closed |
| 6 | the feeder or its guard is halted for 0.3 s |
| 7 | the feeder or its guard is killed |
| 8 | LinuxCNC's `rtapi_app` is killed, or all processes of the feeder |
| 9 | Ctrl-C on the terminal of the command line; its log is refused by `learn` |
"""

from __future__ import annotations

import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path as FilePath

import numpy as np

import armcontour as ac
from armcontour.controllers import LinuxCNC, Played, PlayedMotion, play
from armcontour.core.errors import ControllerLost
from armcontour.core.progress import Step
from soak import Outcome
from soak.hal_drives import CYCLE, KP, KV, LIMIT, distances, tool

# Largest distance of the measured tool from the path [m].
DISTANCE = 5e-6
# Largest ratio of the demanded to the allowed acceleration of a drive.
DEMAND = 1.0
# Largest speed of a joint at the end [rad/s].
REST = 1e-4
# The servo is the one that `identify` finds in a log of these drives, whose loops have a cycle.
JOB = """
name: played
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]}
corners: {tolerance: 5 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25.025 1/s, kv: 163.02 1/s, dead_time: 0.041 ms}
# Limited set-points would saturate the drives.
command_limits: {joint_acceleration: inf}
plant: {kp: 25 1/s, kv: 150 1/s, dead_time: 0 ms}
runs:
  only: {timing: {reserve: 2 %}, compensation: {method: inverse}, cycle: 1 ms}
"""
FEEDER = "armcontour.controllers.feeders.linuxcnc_feeder"
# Longest time of a motion with its begin and end [s].
PATIENCE = 60.0
ATTEMPTS = 3
# Requests after this may come too late for a stop [s].
LATEST = 4.4
# Overrides of a motion, and how long each is wanted [s].
OVERRIDES = (0.0, 0.1, 0.25, 0.5, 1.0, 1.0, 1.0)
OVERRIDE_PERIOD = 0.4
# Last point of the path [m].
END = np.array([0.350, 0.350])


@cache
def paper_job() -> ac.Job:
    """Read the job that is played."""
    file = FilePath(tempfile.mkdtemp(prefix="playing-")) / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    job = ac.read_job(file)
    shutil.rmtree(file.parent)
    return job


def new_controller() -> LinuxCNC:
    """Start LinuxCNC with simulated drives as in the job."""
    return LinuxCNC(drives=ac.ServoModel(kp=KP, kv=KV, acceleration_limit=LIMIT))


def judge(t: np.ndarray, command: np.ndarray, measured: np.ndarray) -> tuple[list[str], float]:
    """Return what is wrong with a recorded motion, and its demand over the limit."""
    if len(measured) < 3:
        return ["nothing was recorded"], 0.0
    # A process that is killed takes samples with it.
    speed = np.diff(measured, axis=0) / CYCLE
    demand = KV * (KP * (command[1:] - measured[1:]) - speed)[np.diff(t) < 1.5 * CYCLE]
    ratio = float(np.abs(demand).max() / LIMIT)
    distance = float(distances(tool(measured)).max())
    last = float(np.abs(speed[-20:]).max())
    notes = [f"{1e3 * distance:.6f} mm from the path"] if distance > DISTANCE else []
    notes += [f"demand {ratio:.6f} of the limit"] if ratio > DEMAND else []
    notes += [f"{last:.2e} rad/s at the end"] if last > REST else []
    figures.append((1e3 * distance, ratio))
    return notes, ratio


# Largest distance [mm] and demand over the limit of each motion, of this process.
figures: list[tuple[float, float]] = []


def processes(word: str) -> list[int]:
    """List the processes below this one whose command line has a word."""
    found = []
    parents = {os.getpid()}
    table = sorted(int(x) for x in os.listdir("/proc") if x.isdigit())
    for _ in range(4):
        for pid in table:
            try:
                parent = int(
                    FilePath(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1]
                )
                line = FilePath(f"/proc/{pid}/cmdline").read_text()
            except OSError:
                continue
            if parent in parents and pid not in parents:
                parents.add(pid)
                found += [pid] if word in line else []
    return found


def programs(folder: FilePath) -> list[int]:
    """List the processes of `rtapi_app` whose socket is below a folder."""
    found = []
    for entry in FilePath("/proc").glob("[0-9]*"):
        try:
            if b"rtapi_app" in (entry / "cmdline").read_bytes():
                found += (
                    [int(entry.name)]
                    if str(folder).encode() in (entry / "environ").read_bytes()
                    else []
                )
        except OSError:
            continue
    return found


class CameLate(Exception):
    """Set-points came late, as the machine was too busy."""


class Trial:
    """A motion in a folder of its own, in which something happens after a time.

    Args:
        draw: Draws the override over time.
        at: Time after the begin of the motion [s].
        event: What happens then.
    """

    def __init__(
        self,
        draw: random.Random,
        at: float = np.inf,
        event: Callable[[Trial], None] = lambda x: None,
    ) -> None:
        self.overrides = [draw.choice(OVERRIDES) for _ in range(round(LATEST / OVERRIDE_PERIOD))]
        self.at = at
        self.event = event
        self.begun = np.inf
        self.happened = False
        self.folder = FilePath(tempfile.mkdtemp(prefix="playing-"))
        self.folder.chmod(0o755)
        self.stop = False

    def tell(self, step: Step) -> None:
        """Note the steps that `play` reports, the last of which is the motion."""
        if "playing" in step.names:
            self.begun = min(self.begun, time.monotonic())

    def override(self) -> float:
        """Return the wanted override, which changes during the motion."""
        elapsed = time.monotonic() - self.begun
        period = int(max(elapsed, 0.0) / OVERRIDE_PERIOD) if np.isfinite(elapsed) else 0
        return self.overrides[period] if period < len(self.overrides) else 1.0

    def stop_requested(self) -> bool:
        """Return whether a stop is due; `play` calls this during the motion."""
        # Before the motion the player looks once.
        if not self.happened and time.monotonic() - self.begun > self.at:
            self.happened = True
            self.event(self)
        return self.stop

    def play(self) -> Played:
        """Play the job."""
        tempfile.tempdir = str(self.folder)
        try:
            job = paper_job()
            played = play(
                job,
                new_controller(),
                execute=True,
                override=self.override,
                stop_requested=self.stop_requested,
                progress=self.tell,
            )
        finally:
            tempfile.tempdir = None
        assert played.record is not None
        late = any("came late" in x for x in played.record.notes)
        if late or (np.isfinite(self.at) and not self.happened):
            self.close()
            raise CameLate
        return played

    def lost(self) -> tuple[str, PlayedMotion]:
        """Play the job, in which the controller has to be lost."""
        try:
            played = self.play()
        except ControllerLost as error:
            assert isinstance(error.record, PlayedMotion)
            return str(error), error.record
        assert played.record is not None
        return "", played.record

    def close(self) -> list[str]:
        """Remove the folder; what was left running."""
        end = time.monotonic() + 5.0
        while (left := programs(self.folder)) and time.monotonic() < end:
            time.sleep(0.05)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        shutil.rmtree(self.folder, ignore_errors=True)
        return [f"left running: {len(left)} rtapi_app"] if left else []


def ask(trial: Trial) -> None:
    """Request a stop."""
    trial.stop = True


def feeders() -> list[int]:
    """List guard and feeder; on a busy machine one may have replaced the other."""
    found = sorted(processes(FEEDER))
    if len(found) != 2:
        raise CameLate
    return found


def try_stop(draw: random.Random) -> Outcome:
    """Stop at a random time, also near the ends."""
    trial = Trial(draw, draw.uniform(0.0, 5.2), ask)
    played = trial.play()
    record = played.record
    assert record is not None
    notes, ratio = judge(record.t, record.command, record.measured)
    if record.stopped is None and trial.at < LATEST:
        notes.append(f"asked at {trial.at:.3f} s, but not stopped")
    notes += record.notes if notes else []
    result = "stopped" if record.stopped is not None else "ended"
    return Outcome(kind="stop", result=result, notes=notes + trial.close(), worst=ratio)


def try_killed_player(draw: random.Random) -> Outcome:
    """Send `kill -9` to the process that plays."""
    trial = Trial(draw)
    program = f"from soak.playing import *; Trial(random.Random({draw.random()})).play()"
    environment = {**os.environ, "TMPDIR": str(trial.folder)}
    player = subprocess.Popen([sys.executable, "-c", program], env=environment)
    file = _wait_for(lambda: next(iter(trial.folder.rglob("samples.csv")), None))
    _wait_for(lambda: has_begun(file))
    time.sleep(draw.uniform(0.0, 4.0))
    player.kill()
    player.wait()
    _wait_for(lambda: None if programs(trial.folder) else True)
    # Time, commands, measured positions, and cycle of the motion.
    table = np.loadtxt(file, delimiter=",")
    table = table[int(np.argmax(table[:, 5] == 0)) :]
    if (np.diff(table[:-1200, 5]) == 0).any():
        trial.close()
        raise CameLate
    notes, ratio = judge(table[:, 0], table[:, 1:3], table[:, 3:5])
    is_at_end = float(np.abs(tool(table[-1:, 3:5])[0] - END).max()) < DISTANCE
    result = "ended" if is_at_end else "stopped"
    return Outcome(kind="player killed", result=result, notes=notes + trial.close(), worst=ratio)


def try_closed_pipe(draw: random.Random) -> Outcome:
    """Close the pipe to the feeder, as if the connection had been pulled."""

    def close(trial: Trial) -> None:
        (guard, _) = feeders()
        pipe = os.readlink(f"/proc/{guard}/fd/0")
        for entry in os.listdir("/proc/self/fd"):
            if int(entry) > 2 and os.path.exists(f"/proc/self/fd/{entry}"):
                if os.readlink(f"/proc/self/fd/{entry}") == pipe:
                    other = os.open(os.devnull, os.O_WRONLY)
                    os.dup2(other, int(entry))
                    os.close(other)

    trial = Trial(draw, draw.uniform(0.0, 4.5), close)
    said, record = trial.lost()
    notes, ratio = judge(record.t, record.command, record.measured)
    ended = record.stopped is None and trial.at < LATEST
    notes += [f"not stopped: {said}"] if ended else []
    return Outcome(kind="pipe closed", result="stopped", notes=notes + trial.close(), worst=ratio)


def try_halt(draw: random.Random) -> Outcome:
    """Halt the feeder or its guard for 0.3 s."""
    number = draw.choice([0, 1])

    def halt(trial: Trial) -> None:
        pid = feeders()[number]
        os.kill(pid, signal.SIGSTOP)

        def go_on() -> None:
            try:
                os.kill(pid, signal.SIGCONT)
            except ProcessLookupError:
                pass

        threading.Timer(0.3, go_on).start()

    trial = Trial(draw, draw.uniform(0.0, 4.5), halt)
    said, record = trial.lost()
    notes, ratio = judge(record.t, record.command, record.measured)
    kind = ("guard halted", "feeder halted")[number]
    result = "stopped" if record.stopped is not None else "ended"
    notes += [f"lost: {said}"] if said else []
    return Outcome(kind=kind, result=result, notes=notes + trial.close(), worst=ratio)


def try_killed_feeder(draw: random.Random) -> Outcome:
    """Send `kill -9` to the feeder or its guard."""
    number = draw.choice([0, 1])
    trial = Trial(
        draw, draw.uniform(0.0, 4.5), lambda x: os.kill(feeders()[number], signal.SIGKILL)
    )
    said, record = trial.lost()
    notes, ratio = judge(record.t, record.command, record.measured)
    kind = ("guard killed", "feeder killed")[number]
    notes += [f"lost: {said}"] if said else []
    notes += [] if record.stopped is not None or trial.at > LATEST else ["not stopped"]
    return Outcome(kind=kind, result="stopped", notes=notes + trial.close(), worst=ratio)


def try_lost_controller(draw: random.Random) -> Outcome:
    """Send `kill -9` to LinuxCNC, or to both feeder processes: no stop, but a record."""
    controller = draw.random() < 0.5

    def kill(trial: Trial) -> None:
        for pid in programs(trial.folder) if controller else feeders():
            os.kill(pid, signal.SIGKILL)

    trial = Trial(draw, draw.uniform(0.3, 4.5), kill)
    said, record = trial.lost()
    notes = [] if said else ["the motion ended as if nothing had happened"]
    if len(record.t) < 1000 * trial.at - 500:
        notes.append(f"{len(record.t)} samples of {trial.at:.3f} s were kept")
    kind = "LinuxCNC killed" if controller else "feeder and guard killed"
    return Outcome(kind=kind, result="lost", notes=notes + trial.close())


def try_command_line(draw: random.Random) -> Outcome:
    """Press Ctrl-C on a terminal at a random time, then give the log to `learn`."""
    trial = Trial(draw)
    (trial.folder / "job.yaml").write_text(JOB, encoding="utf-8")
    command = [sys.executable, "-m", "armcontour", "play", "job.yaml", "--on", "linuxcnc"]
    command += ["--execute", "--speed-factor", "100 %", "--out", "out"]
    pid, terminal = pty.fork()
    if not pid:
        os.chdir(trial.folder)
        os.environ["TMPDIR"] = str(trial.folder)
        os.execv(sys.executable, command)
    said = b""
    while b"Type PMK-3s" not in said:
        said += os.read(terminal, 1000)
    os.write(terminal, b"PMK-3s\n")
    printed: list[bytes] = []
    threading.Thread(target=_drain, args=(terminal, printed), daemon=True).start()
    file = _wait_for(lambda: next(iter(trial.folder.rglob("unfinished.csv")), None))
    _wait_for(lambda: has_begun(file))
    time.sleep(draw.uniform(0.0, 4.0))
    os.write(terminal, b"\x03")
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    os.close(terminal)
    notes = [] if code == 1 else [f"exit code {code}: {b''.join(printed)[-300:]!r}"]
    ratio = 0.0
    if b"came late" in b"".join(printed):
        trial.close()
        raise CameLate
    if not notes:
        log = ac.read_log(trial.folder / "out" / "log.csv")
        notes, ratio = judge(log.t, log.command, log.measured)
        learn = [sys.executable, "-m", "armcontour", "learn", "job.yaml", "--log", "out/log.csv"]
        done = subprocess.run(
            [*learn, "--out", "next"], cwd=trial.folder, capture_output=True, text=True
        )
        if not done.returncode or "Traceback" in done.stderr:
            notes.append(f"learn took the log of a stop: {done.stderr[-200:]}")
    return Outcome(kind="Ctrl-C", result="stopped", notes=notes + trial.close(), worst=ratio)


def has_begun(file: FilePath) -> bool:
    """Return whether a record has rows of a motion."""
    lines = file.read_text().splitlines()[:-1]
    # A record in a result folder begins with comments and titles.
    return bool(lines) and lines[-1].split(",")[-1].isdigit()


def _drain(terminal: int, printed: list[bytes]) -> None:
    try:
        while data := os.read(terminal, 1000):
            printed.append(data)
    except OSError:
        return


def _wait_for(look: Callable[[], object]) -> FilePath:
    """Wait until something is there, and return it."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if found := look():
            return found  # type: ignore[return-value]
        time.sleep(0.01)
    raise TimeoutError("It did not happen.")


TRIALS = [
    *[try_stop] * 4,
    try_killed_player,
    try_closed_pipe,
    try_halt,
    try_killed_feeder,
    try_lost_controller,
    try_command_line,
]


def run(seed: int) -> Outcome:
    """Play the motion of a seed; again where the machine was too busy, which the record shows."""
    if shutil.which("halcmd") is None:
        return Outcome(kind="LinuxCNC", result="not installed")
    draw = random.Random(seed)
    for _ in range(ATTEMPTS):
        try:
            return TRIALS[seed % len(TRIALS)](draw)
        except CameLate:
            continue
    return Outcome(kind="LinuxCNC", result="came late")
