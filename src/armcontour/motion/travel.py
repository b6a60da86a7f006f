"""Upper bounds of joint velocities and travel in every part of a motion."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.motion import kernels
from armcontour.motion.execution import Execution
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import LapLaw, Law, PathLaw
from armcontour.motion.trajectory import Trajectory

# Relative allowance of the bounds for rounding.
ROUNDING = 1e-12


def joint_travel(motion: Trajectory | Execution | JointPath) -> tuple[FloatArray, FloatArray]:
    """Times [s], and upper bounds of each joint's travel from the start to these times [rad]."""
    # Motion in both directions adds to the travel. The bound is linear between the times. A joint
    # moves at most by the increase of the bound between any two times.
    # `motion`: a planned or an executed motion, or a joint path, for which arc length replaces
    # time. Between its samples, the accelerations of an executed motion are assumed to be at most
    # the largest demand or sampled acceleration.
    # Returns times from the start to the end, (n,), and the bounds, (n, dof).
    parts: Iterable[FloatArray]
    if isinstance(motion, Execution):
        t, dof, rate = motion.t, motion.q.shape[1], np.abs(motion.dq)
        gained = largest_accelerations(motion) * (np.diff(t)[:, None] / 2)
        parts = [np.maximum(rate[:-1], rate[1:]) + gained]
    elif isinstance(motion, JointPath):
        t, dof = motion.breaks, motion.dof
        parts = [_bound_along(motion, t, np.ones(len(t) - 1))]
    else:
        inner = [a + x.breaks[:-1] for a, x in zip(motion.starts, motion.laws, strict=False)]
        t = np.append(np.concatenate(inner), motion.starts[-1])
        dof, parts = motion.dof, map(bound_joint_velocities, motion.laws)
    # A single array saves memory, because a long motion has millions of intervals.
    travel, done = np.zeros((len(t), dof)), 1
    for fastest in parts:
        travel[done : done + len(fastest)] = fastest
        done += len(fastest)
    travel[1:] *= np.diff(t)[:, None] * (1 + ROUNDING)
    np.cumsum(travel, axis=0, out=travel)
    return t, travel


def largest_accelerations(motion: Execution) -> FloatArray:
    """Bounds of the joint accelerations of an executed motion [rad/s²], (dof,)."""
    demanded, had = np.abs(motion.demand_range).max(axis=0), np.abs(motion.ddq).max(axis=0)
    return np.asarray(np.maximum(demanded, had))


@singledispatch
def bound_joint_velocities(law: Law) -> FloatArray:
    """Bounds of the joint velocities within every interval of a law [rad/s], (n, dof)."""
    raise InvalidInput(
        f"The joint velocities of a law of the kind {type(law).__name__} have no known bound. Use "
        "the law of a plan."
    )


@bound_joint_velocities.register
def _(law: LapLaw) -> FloatArray:
    """Bounds for a `LapLaw`, whose velocities are linear between breaks."""
    end = law.dq + law.ddq * np.diff(law.breaks)[:, None]
    return np.asarray(np.maximum(np.abs(law.dq), np.abs(end)))


@bound_joint_velocities.register
def _(law: PathLaw) -> FloatArray:
    """Bounds for a `PathLaw`: products of the bounds of dq_ds and of ds."""
    return _bound_along(law.joint_path, law.s, _bound_path_speeds(law))


def _bound_path_speeds(law: PathLaw) -> FloatArray:
    """Bounds of the path speed within every interval [m/s], (n,)."""
    (ds, dds, slope, jerk), speeds = law.rates, law.speeds
    # ds² is a parabola over s, or, with jerk, ds is a parabola over time. The peak is where the
    # path acceleration is 0.
    with np.errstate(divide="ignore", invalid="ignore"):
        over_s = np.where(slope < 0, np.sqrt(ds**2 - dds**2 / slope), 0.0)
        peaks = np.where(jerk < 0, ds - dds**2 / (2 * jerk), over_s)
    return np.maximum(np.maximum(speeds[:-1], speeds[1:]), np.where(dds > 0, peaks, 0.0))


def _bound_along(joint_path: JointPath, s: FloatArray, speeds: FloatArray) -> FloatArray:
    """Bounds of the joint velocities between neighbouring arc lengths [rad/s], (n, dof)."""
    return np.asarray(
        kernels.bound_joint_velocities(joint_path.breaks, joint_path.coefficients, s, speeds)
    )
