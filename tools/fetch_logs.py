"""Fetch logs of real robots that may not be redistributed, and write them as CSV for `identify`.

`python tools/fetch_logs.py FOLDER` downloads the files of docs/guides/tried_robots.md from pinned
commits.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote
from urllib.request import urlopen

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

SOURCE = "https://raw.githubusercontent.com/{}/{}/{}"
KUKA = "anjan211/kuka_controller_project", "6e23e6a"
PANDA = "marcocognetti/FrankaEmikaPandaDynModel", "24d85ce"
ABB = "rpiRobotics/ARM-21-02-F-19-Robot-Motion-Program", "00a7cb4"
# Axis degrees per unit of the KR C4's trace.
KUKA_UNITS = np.array(
    [-1.26582278e-08, 1.10229277e-08, 1.12044815e-08, -1.25e-08, -1.27867427e-08, 1.96078427e-08]
)
# A pause longer than this is a lost packet [s].
LOST = 0.01
TRACES = {
    "krc4_pitch": "CircularReal/WINDOWS-V37DJA1 - 8101392_pitch",
    "krc4_rect1": "Linear_Cube/WINDOWS-V37DJA1 - 8101392_Lin_trial_rect1",
    "krc4_rect2": "Linear_Cube/WINDOWS-V37DJA1 - 8101392_Lin_trial_rect2",
}
PANDA_FILES = (
    *("gen_dq", "gen_time", "gen_q0"),
    *("rbt_log/exciting_traj_time", "rbt_log/exciting_traj_positions"),
)
Table = npt.NDArray[np.float64]


def from_kuka(traces: Sequence[str]) -> Table:
    """Time [s], commands and measured positions [deg] from oscilloscope traces of six axes."""
    axes = [np.loadtxt(x.splitlines(), delimiter=";", skiprows=1, ndmin=2) for x in traces]
    n = min(map(len, axes))
    command, measured = (
        np.column_stack([x[:n, k] for x in axes]) * KUKA_UNITS[: len(axes)] for k in (1, 2)
    )
    return np.column_stack([axes[0][:n, 0], command, measured])


def from_panda(dq: str, rate_times: str, q0: str, time: str, positions: str) -> Table:
    """Time [s], integrated velocity commands and measured positions [rad], until a lost packet.

    The files have one value per line; those of the seven joints follow each other.
    """
    rate, at_times, start, t, q = (
        np.loadtxt(x.splitlines(), ndmin=1) for x in (dq, rate_times, q0, time, positions)
    )
    joints = len(start)
    moved = start + cumulative_trapezoid(rate.reshape(-1, joints), at_times, axis=0, initial=0)
    gaps = np.flatnonzero(np.diff(t) > LOST)
    n = gaps[0] + 1 if len(gaps) else len(t)
    command = [np.interp(t[:n], at_times, x) for x in moved.T]
    return np.column_stack([t[:n], *command, q.reshape(-1, joints)[:n]])


def from_abb(run: str) -> Table:
    """Time [s], line of the program and measured positions of the first robot [deg]."""
    rows = run.splitlines()[1:]
    return np.loadtxt(rows, delimiter=",", usecols=range(8), ndmin=2)


def write(file: Path, table: Table, header: Sequence[str]) -> None:
    """Write a table as CSV."""
    file.parent.mkdir(parents=True, exist_ok=True)
    names = ",".join(["t [s]", *header])
    np.savetxt(file, table, delimiter=",", fmt="%.9g", header=names, comments="")


def joints(count: int, unit: str) -> list[str]:
    """Name the columns of commands and measured positions."""
    return [
        f"{quantity} {j + 1} [{unit}]" for quantity in ("command", "measured") for j in range(count)
    ]


def fetch(repository: tuple[str, str], file: str) -> str:
    """Fetch the text of a file in a repository at a commit."""
    with urlopen(SOURCE.format(*repository, quote(file)), timeout=60) as reply:
        return str(reply.read().decode("latin1"))


def main(folder: Path) -> None:
    """Fetch all logs into a folder."""
    for name, stem in TRACES.items():
        files = [f"Traces_Real/{stem}_NextGenDrive#{j}.csv" for j in range(1, 7)]
        table = from_kuka([fetch(KUKA, x) for x in files])
        write(folder / "kuka_kr3_krc4" / f"{name}.csv", table, joints(6, "deg"))
    path = "matlab/data/Exciting_Traj/Trajectory_1/{}.txt"
    table = from_panda(*(fetch(PANDA, path.format(x)) for x in PANDA_FILES))
    write(folder / "panda" / "panda_gaz_first_part.csv", table, joints(7, "rad"))
    path = "data_performance_abb/curve_1/curve_pose_opt1/100L/realrobot/run_{}.csv"
    for k in range(5):
        table = from_abb(fetch(ABB, path.format(k)))
        names = ["program line", *(f"J{j} [deg]" for j in range(1, 7))]
        write(folder / "abb_irb6640" / f"run_{k}.csv", table, names)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
