"""Public function `transfer`: what was learned of a path, for another timing of the same path."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._sampling import interpolate
from armcontour.arms import Arm, Limits
from armcontour.drives.drives import CREEP
from armcontour.errors import InvalidInput
from armcontour.learning.estimating import choose_penalty, unexplained
from armcontour.learning.learner import allowed_accelerations, keep_limits, start_early
from armcontour.learning.lesson import LearnedRun, Lesson, TransferredData
from armcontour.learning.lifted import Lifted, Nominal
from armcontour.motion import TaughtData, Trajectory
from armcontour.servo import ServoModel

# Joint paths are the same if they differ by at most this [rad] where the joints have come equally
# far; the tool then differs by some 0.1 mm.
SAME = 1e-4
# Samples of each motion by which paths are compared.
SAMPLES = 20001
# The causes explain what was learned at best but for this share, which keeps causes small that
# cannot be told apart.
UNTOLD = 1e-2
# Penalty of changes of set-points, as in `Lifted.correct`: what is carried over has no noise.
SMOOTH = 1e-4


def transfer(
    lesson: Lesson,
    taught: TaughtData,
    *,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None = None,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
) -> TransferredData:
    """Set-points for another timing of a path that was learned.

    What the robot needs beyond its model is split into causes with a known dependence on speed:
    wrong gains, friction, drive inertias and payload. What they do not explain is carried over by
    the place on the path. Give the result, and the log of its run, to `learn`.

    Args:
        lesson: What was learned of the path.
        taught: Set-points for the new timing by the model alone, as from `compensate`.
        arm: The nominal arm, as in `learn`.
        servo: The nominal servo.
        limits: Limits of the controller, as in `learn`.
        gravity_feedforward: Whether the controller adds the torque against gravity.
        known: The arm as its controller knows it, as in `learn`.

    Raises:
        InvalidInput: The path is another one.
        CompensationError: The set-points exceed the limits before anything is carried over.
    """
    way = _Way(lesson.trajectory, taught.trajectory)
    nominal = Nominal(
        arm=arm, servo=lesson.servo,
        gravity_feedforward=gravity_feedforward, known=known,
    )  # fmt: skip
    old = lesson.lifted or Lifted(lesson, nominal)
    taught = start_early(taught, lesson.delay)
    new = Lifted(taught, nominal)
    best = lesson.runs[lesson.best]
    factors, rest, explained = _explain(nominal, old, best, lesson.runs[0])
    at_place = interpolate(way.learned_at(new.t), old.t, rest)
    command = _causes(nominal, new.plan, new.t) @ factors + at_place
    error = new.expected(taught.q) - new.planned - new.respond_to(command)
    change, _ = new.correct(error, SMOOTH)
    fastest = allowed_accelerations(taught.q, taught.period, limits)
    fastest = np.maximum(fastest, allowed_accelerations(best.q, lesson.period, limits))
    share, reason = keep_limits(taught, taught.q, change, limits, fastest)
    return TransferredData(
        period=taught.period,
        q=taught.q + share * change,
        trajectory=taught.trajectory,
        method="learning",
        start_time=taught.start_time,
        explained=explained,
        servo=lesson.servo,
        delay=lesson.delay,
        reason=reason,
    )


def _explain(
    nominal: Nominal, lifted: Lifted, run: LearnedRun, first: LearnedRun
) -> tuple[FloatArray, FloatArray, float]:
    """Splits what a robot needs beyond its model into causes and a rest.

    Args:
        nominal: The nominal robot.
        lifted: Its model along the plan.
        run: The run that shows it.
        first: The run before learning.

    Returns:
        Factors of the causes, (causes,); the command that they leave unexplained at the model's
        times [rad], (n, dof); and the share that they explain.
    """
    needed = lifted.expected(run.q) - lifted.planned - run.error
    causes = _causes(nominal, lifted.plan, lifted.t)
    moved = lifted.respond_to(causes).reshape(needed.size, -1)
    size = np.linalg.norm(moved, axis=0)
    moved, scale = moved[:, size > 0] / size[size > 0], np.zeros(len(size))
    scale[size > 0] = 1 / size[size > 0]
    likely = UNTOLD**2 / needed.size * np.eye(moved.shape[1])
    found = np.linalg.solve(moved.T @ moved + likely, moved.T @ needed.ravel())
    left = needed - (moved @ found).reshape(needed.shape)
    variance = float(np.mean(unexplained(run.noise, left)))
    change, _ = lifted.correct(-left, choose_penalty(lifted, left, variance))
    noise = float(np.mean(run.noise**2))
    moving = (lifted.t >= 0) & (lifted.t <= lifted.plan.duration)
    learned = lifted.respond(run.q - first.q)
    power, lost = (max(float(np.mean(x[moving] ** 2)) - noise, 0.0) for x in (learned, left))
    explained = 1 - lost / power if power > lost else 0.0
    factors = np.zeros(len(size))
    factors[size > 0] = found
    return factors * scale, lifted.reaching(change), explained


def _causes(nominal: Nominal, plan: Trajectory, t: FloatArray) -> FloatArray:
    """Commands that a motion needs per unit of each cause, (n, dof, causes).

    Of every joint: its velocity (gains, viscous friction), direction (Coulomb friction),
    acceleration (drive inertia) and torque (gains). Of arms with masses: ten of a payload.

    Args:
        nominal: The nominal robot.
        plan: The motion.
        t: Times [s], (n,).
    """
    q, dq, ddq = plan.motion_with_rests(t)
    own = [dq, np.clip(dq / CREEP, -1.0, 1.0), ddq]
    if nominal.has_bodies:
        drives = nominal.drives
        own.append(drives.moving_torque(q, dq, ddq))
    each = [x[:, :, None] * np.eye(x.shape[1]) for x in own]
    if nominal.has_bodies:
        load = nominal.arm.dynamics.last_body_regressor(q, dq, ddq)
        each.append(load / drives.stiffness[:, None])
    return np.concatenate(each, axis=2)


class _Way:
    """Where two motions along the same joint path are equally far.

    Args:
        learned: The motion that was learned.
        new: The other motion.

    Raises:
        InvalidInput: The joint paths differ.
    """

    def __init__(self, learned: Trajectory, new: Trajectory) -> None:
        (self._t, q), (self._new_t, other) = (_sample(x) for x in (learned, new))
        self._come, self._new_come = _distance(q), _distance(other)
        at = np.interp(self._come, self._new_come, np.arange(len(other)))
        same = interpolate(at, np.arange(len(other), dtype=np.float64), other)
        off = np.abs(same - q).max(axis=1)
        k = int(np.argmax(off))
        if off[k] > SAME:
            raise InvalidInput(
                f"The new plan is not on the path that was learned: {self._t[k]:.4g} s after the "
                f"start of the learned one its joints are {off[k]:.3g} rad away, and {SAME:g} rad "
                "would be the same path. Only its speed may differ: learn the new path anew.",
                needed=float(off[k]),
                allowed=SAME,
            )

    def learned_at(self, t: FloatArray) -> FloatArray:
        """Times of the learned motion at the place of the new motion [s], (n,).

        Args:
            t: Times of the new motion [s], (n,).
        """
        share = np.interp(t, self._new_t, self._new_come)
        moving = np.append(True, np.diff(self._come) > 0)
        return np.asarray(np.interp(share, self._come[moving], self._t[moving]))


def _sample(plan: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Regular times of a motion [s], (n,), and its joint positions there [rad], (n, dof)."""
    t = np.asarray(np.linspace(0.0, plan.duration, SAMPLES))
    return t, plan(t)


def _distance(q: FloatArray) -> FloatArray:
    """Distance that joints have come, as a share of the whole one, (n,)."""
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    found = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(found / max(float(found[-1]), 1e-300))
