"""Functions that several planners share: assigned speeds, path laws, and peaks along laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.geometry import Path, ShapedPath
from armcontour.motion import JointPath, Law, PathLaw, Rates
from armcontour.program import Program
from armcontour.timing.limit_use import States, quantity

# Samples per smooth piece of a law. A piece turns by half a radian at most, so the sampled peak is
# less than the true peak by under a part in ten thousand.
PEAK_SAMPLES = 33
# Limits that a reserve reduces.
RESERVED = ("joint_acceleration", "joint_deceleration", "joint_torque")


def with_reserve(limits: Limits, reserve: float) -> Limits:
    """Reduce the limits of joint acceleration and torque by a share.

    Args:
        limits: The limits.
        reserve: Share to subtract, from 0 to below 1.

    Raises:
        InvalidInput: `reserve` is out of this range.
    """
    if not 0 <= _checks.number("reserve", reserve) < 1:
        raise InvalidInput(f"reserve must be a share from 0 to below 1, but is {reserve:g}.")
    if not reserve:
        return limits
    left = {
        name: (1 - reserve) * value
        for name in RESERVED
        if (value := getattr(limits, name)) is not None
    }
    return limits.replace(**left) if left else limits


def start_of(program: Program, given: npt.ArrayLike | None = None) -> npt.ArrayLike | None:
    """Where an arm starts a program: as given, else where its contours were shaped, if anywhere.

    Args:
        program: The program.
        given: The start that is given; None for none.
    """
    if given is not None:
        return given
    found = [x.path.outcome.joints for x in program.contours if isinstance(x.path, ShapedPath)]
    return found[0] if found else None


def tool_path_of(joint_path: JointPath, method: str) -> Path:
    """The tool path that a joint path follows.

    Raises:
        InvalidInput: The joint path has no tool path.
    """
    if joint_path.tool_path is None:
        raise InvalidInput(
            f"The method {method} plans along a tool path: give it a Path, or a traced one."
        )
    return joint_path.tool_path


def require_speed(limits: Limits, method: str) -> float:
    """The assigned velocity [m/s], without which a method cannot plan.

    Raises:
        InvalidInput: The limits have no assigned velocity.
    """
    if limits.speed is None:
        raise InvalidInput(
            f"The method {method} needs an assigned velocity: give the limit speed [m/s]."
        )
    return limits.speed


def segment_speeds(path: Path, speed: float) -> FloatArray:
    """Assigned velocity of each segment [m/s], (n,): its own velocity, but at most `speed`."""
    return np.fmin(path.speeds, speed)


def path_law(joint_path: JointPath, s: FloatArray, start: FloatArray, end: FloatArray) -> PathLaw:
    """The time law with a uniform path acceleration on each interval.

    Args:
        joint_path: The joint path.
        s: Arc lengths of the interval ends [m], (n + 1,).
        start: Tool speed at the start of each interval [m/s], (n,).
        end: Tool speed at the end of each interval [m/s], (n,).
    """
    lengths = np.diff(s)
    times = 2 * lengths / (start + end)
    none = np.zeros_like(lengths)
    rates = Rates(ds=start, dds=(end - start) / times, slope=none, jerk=none)
    return PathLaw(
        joint_path=joint_path, breaks=np.concatenate([[0.0], np.cumsum(times)]), s=s, rates=rates
    )


@dataclass(frozen=True, slots=True)
class Peaks:
    """Largest values along a law.

    Args:
        acceleration: Largest acceleration of each joint, without sign [rad/s²], (dof,).
        speed: Largest tool speed [m/s].
    """

    acceleration: FloatArray
    speed: float


def law_peaks(law: Law, arm: Arm) -> Peaks:
    """Find the largest joint accelerations, (27), and the largest tool speed along a law."""
    states = law_states(law, arm)
    return Peaks(np.abs(states.ddq).max(axis=0), float(quantity("speed", states).max()))


def law_states(law: Law, arm: Arm) -> States:
    """Joint states at the samples of a law."""
    i, t = sample_times(law)
    return States(arm, *(law.on_interval(i, t, order) for order in (0, 1, 2)))


def sample_times(law: Law) -> tuple[IntArray, FloatArray]:
    """Samples of a law that include its peaks.

    Returns:
        The interval of each sample, (n,), and its time [s], (n,).
    """
    knots = _smooth_pieces(law) if isinstance(law, PathLaw) else law.breaks
    count = PEAK_SAMPLES if isinstance(law, PathLaw) else 3
    grid = np.linspace(knots[:-1], knots[1:], count)
    interval = np.searchsorted(law.breaks, (knots[:-1] + knots[1:]) / 2, side="right") - 1
    return np.broadcast_to(interval, grid.shape).ravel(), grid.ravel()


def _smooth_pieces(law: PathLaw) -> FloatArray:
    """Times [s] between which both s(t) and the joint path are one polynomial each."""
    inner = law.joint_path.breaks
    inner = inner[(inner > law.s[0]) & (inner < law.s[-1])]
    return np.unique(np.concatenate([law.breaks, law.reach(inner)[1]]))
