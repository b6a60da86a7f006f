"""Measure the paper's Table I on LinuxCNC: `python -m soak.paper_table`.

This plays the conventional and the proposed run in real time on simulated drives of LinuxCNC's HAL.
The exit code is 1 if a figure differs from the row "controller: LinuxCNC" of docs/paper.md.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

import armcontour as ac
from armcontour.controllers import LinuxCNC, Motion
from soak.hal_drives import CYCLE, KP, KV, LIMIT, TOLERANCE, distances, tool

PAGE = Path(__file__).parents[1] / "docs" / "paper.md"
SERVO = ac.ServoModel(kp=KP, kv=KV)
DRIVES = SERVO.replace(acceleration_limit=LIMIT)
# Time over which the conventional error is averaged, as in Table I [s].
CONVENTIONAL = 12.06
# A tool at rest is slower than this [m/s].
REST = 1e-3
NAMES = ("conventional", "proposed", "proposed, 4 ms")
# Attempts on a machine that is too busy.
ATTEMPTS = 5
# RMS and largest contour error [mm], planned time, time until at rest [s].
Figures = tuple[float, float, float, float]


def runs() -> dict[str, tuple[ac.SetPoints, float, float]]:
    """Set-points, corner error [m] and end of the average [s] (0: when at rest) by their names."""
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    objective = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)])
    rounded = ac.round_corners(objective, tolerance=TOLERANCE)
    slow = ac.plan(objective, arm, limits.replace(speed=0.04), ac.Conventional())
    proposed = ac.plan(rounded, arm, limits, ac.Paper(knots=600))
    # The paper does not limit set-points.
    free = ac.Limits(joint_acceleration=np.inf)
    none = ac.NoCompensation(command_limits=free)
    poles = ac.PolePlacement(command_limits=free)
    return {
        "conventional": (ac.compensate(slow, SERVO, none, cycle=2e-4), 0.0, CONVENTIONAL),
        "proposed": (ac.compensate(proposed, SERVO, poles, cycle=2e-4), TOLERANCE, 0.0),
        "proposed, 4 ms": (ac.compensate(proposed, SERVO, poles, cycle=4e-3), TOLERANCE, 0.0),
    }


def commands(set_points: ac.SetPoints) -> np.ndarray:
    """Set-points at the cycles of the thread, joined by lines, with a rest [rad], (n, dof)."""
    q = set_points.q
    times = np.arange(len(q)) * set_points.cycle
    t = np.arange(round((times[-1] + 3.1) / CYCLE)) * CYCLE
    return np.column_stack([np.interp(t, times, x) for x in q.T])


def play(command: np.ndarray) -> np.ndarray:
    """Play a motion on LinuxCNC; return the measured positions [rad], (n, dof)."""
    arm = ac.load_arm("pmk3s")
    for _ in range(ATTEMPTS):
        with LinuxCNC(drives=DRIVES) as on:
            on.connect(arm, command[0])
            record = on.stream(Motion(q=command))
        if record.faithful:
            return record.measured[: len(command)]
    raise RuntimeError(f"This machine is too busy: {' '.join(record.notes)}")


def figures(executed: Callable[[np.ndarray], np.ndarray]) -> dict[str, Figures]:
    """Return the figures of all runs on drives that a function executes."""
    found = {}
    for name, (set_points, corner, end) in runs().items():
        points = tool(executed(commands(set_points)))
        moving = np.linalg.norm(np.diff(points, axis=0), axis=1) > REST * CYCLE
        rest = (int(np.flatnonzero(moving)[-1]) + 1) * CYCLE
        last = round((end or rest) / CYCLE)
        error = 1e3 * distances(points[: last + 1], corner)
        rms = float(np.sqrt(np.mean(error**2)))
        planned = set_points.trajectory.duration
        found[name] = (rms, float(error.max()), planned, rest + set_points.start_time)
    return found


def printed() -> dict[str, list[str]]:
    """Read the figures of the page, as texts."""
    (table,) = re.findall(
        r"controller: LinuxCNC.*\n((?:\|.*\n)+)", PAGE.read_text(encoding="utf-8")
    )
    rows = [[x.strip() for x in line.split("|")[1:-1]] for line in table.splitlines()]
    return {name: texts for name, *texts in rows if name in NAMES}


def differences(found: dict[str, Figures]) -> list[str]:
    """List figures that differ from the page by more than a unit of its last digit."""
    wrong = []
    for name, texts in printed().items():
        for value, text in zip(found[name], texts, strict=True):
            unit = 10.0 ** -len(text.partition(".")[2])
            if abs(value - float(text)) > 1.01 * unit:
                wrong.append(f"{name}: {value:.6f}, but the page has {text}")
    return wrong


def main() -> int:
    """Print the figures; returns the exit code."""
    found = figures(play)
    print(f"{'':16}{'RMS [mm]':>12}{'largest':>12}{'planned [s]':>12}{'at rest':>10}")
    for name, (rms, largest, planned, rest) in found.items():
        print(f"{name:16}{rms:12.6f}{largest:12.6f}{planned:12.4f}{rest:10.3f}")
    wrong = differences(found)
    print("\n".join(wrong) or "As in docs/paper.md.")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
