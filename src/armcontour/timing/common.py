"""What the planners share: path laws of uniform acceleration, speeds, and their joint demand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.motion import JointPath, Law, PathLaw, Rates
from armcontour.timing.limit_use import States, quantity

# Places per smooth piece at which joint motion is looked at: a piece turns by half a radian at
# most, so the top of its curve is missed by less than a part in ten thousand.
PEAK_SAMPLES = 33


def tool_path_of(joint_path: JointPath, method: str) -> Path:
    """The tool path that a joint path follows.

    Raises:
        InvalidInput: There is none.
    """
    if joint_path.tool_path is None:
        raise InvalidInput(
            f"The method {method} plans along a tool path: give it a Path, or a traced one."
        )
    return joint_path.tool_path


def needs_speed(limits: Limits, method: str) -> float:
    """The assigned velocity [m/s].

    Raises:
        InvalidInput: None is given.
    """
    if limits.speed is None:
        raise InvalidInput(
            f"The method {method} needs an assigned velocity: give the limit speed [m/s]."
        )
    return limits.speed


def segment_speeds(path: Path, speed: float) -> FloatArray:
    """Assigned velocity per segment: its own, capped by the limit (n,) [m/s]."""
    return np.fmin(path.speeds, speed)


def path_law(joint_path: JointPath, s: FloatArray, begin: FloatArray, end: FloatArray) -> PathLaw:
    """The law with uniform tool acceleration between given places.

    Args:
        joint_path: The path.
        s: Places [m], (n + 1,).
        begin: Tool speed at the start of each interval [m/s], (n,).
        end: Tool speed at its end [m/s], (n,).
    """
    way = np.diff(s)
    times = 2 * way / (begin + end)
    rates = Rates(ds=begin, dds=(end - begin) / times, slope=np.zeros_like(way))
    return PathLaw(
        joint_path=joint_path, breaks=np.concatenate([[0.0], np.cumsum(times)]), s=s, rates=rates
    )


@dataclass(frozen=True, slots=True)
class Peaks:
    """Largest amounts along a law.

    Args:
        acceleration: Of every joint, (dof,) [rad/s²].
        speed: Of the tool [m/s].
    """

    acceleration: FloatArray
    speed: float


def law_peaks(law: Law, arm: Arm) -> Peaks:
    """Largest joint accelerations, (27), and tool speed along a law."""
    states = law_states(law, arm)
    return Peaks(np.abs(states.ddq).max(axis=0), float(quantity("speed", states).max()))


def law_states(law: Law, arm: Arm) -> States:
    """The arm at the places along a law that are looked at."""
    i, t = law_places(law)
    return States(arm, *(law.on_interval(i, t, order) for order in (0, 1, 2)))


def law_places(law: Law) -> tuple[IntArray, FloatArray]:
    """Intervals and times along a law that are looked at, (n,) each."""
    knots = _smooth_pieces(law) if isinstance(law, PathLaw) else law.breaks
    count = PEAK_SAMPLES if isinstance(law, PathLaw) else 3
    grid = np.linspace(knots[:-1], knots[1:], count)
    interval = np.searchsorted(law.breaks, (knots[:-1] + knots[1:]) / 2, side="right") - 1
    return np.broadcast_to(interval, grid.shape).ravel(), grid.ravel()


def _smooth_pieces(law: PathLaw) -> FloatArray:
    """Times between which s(t) and the joint path are single polynomials."""
    inner = law.joint_path.breaks
    inner = inner[(inner > law.s[0]) & (inner < law.s[-1])]
    return np.unique(np.concatenate([law.breaks, law.reach(inner)[1]]))
