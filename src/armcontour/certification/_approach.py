"""The motion before a contour, as far back as it still affects the servo.

The response of a servo to earlier motion decays. So a contour is executed after the part of the
program that still has an effect, not after the whole program. Set-points have the same phase of the
command interval as in the whole program.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour.certification._uses import Robot
from armcontour.compensation import PolePlacement
from armcontour.motion import Law, Span, TaughtData, Trajectory, stand_still

# After this many of the servo's slowest time constants, 2e-9 of its response is left: of errors of
# millimetres, picometres.
FORGOTTEN = 20.0
# A phase below this share of the command interval counts as zero.
SAME_PHASE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Approach:
    """Laws before a motion, the first of which starts from rest.

    Args:
        laws: The laws; none for the first motion of a program.
    """

    laws: tuple[Law, ...]

    @classmethod
    def of(cls, before: Sequence[Law], robot: Robot) -> Approach:
        """Find the last laws that still affect the servo after their end.

        Joints rest between any two laws of a program. A standstill before the first law gives the
        set-points their phase in the whole program.

        Args:
            before: All laws from the start of the program on.
            robot: The robot and its command interval.
        """
        lasts, k = 0.0, len(before)
        while k > 0 and lasts < memory(robot):
            k -= 1
            lasts += before[k].breaks[-1]
        laws = tuple(before[k:])
        period = robot.run.period
        phase = float(sum(x.breaks[-1] for x in before[:k])) / period
        standing = (phase - np.floor(phase)) * period
        if SAME_PHASE * period < standing < (1 - SAME_PHASE) * period:
            first = laws[0].on_interval(np.zeros(1, dtype=np.intp), np.zeros(1), 0)[0]
            laws = (stand_still(first, float(standing)), *laws)
        return cls(laws=laws)

    @property
    def duration(self) -> float:
        """Duration of all laws [s]."""
        return float(sum(x.breaks[-1] for x in self.laws))

    def teach(self, plan: Trajectory, robot: Robot, period: float | None = None) -> TaughtData:
        """Teach a plan together with the laws before it, which come before the time 0.

        Args:
            plan: The plan, which starts where the laws end.
            robot: The robot.
            period: Time between set-points; by default the command interval [s].
        """
        if not self.laws:
            return robot.teach(plan, period)
        taught = robot.teach(Trajectory(laws=(*self.laws, *plan.laws), method=plan.method), period)
        return TaughtData(
            period=taught.period,
            q=taught.q,
            trajectory=plan,
            method=taught.method,
            start_time=taught.start_time - self.duration,
        )


def approaches(plan: Trajectory, robot: Robot) -> Iterator[tuple[Span, Approach]]:
    """Iterate over the contours of a plan, each with the motion before it.

    Args:
        plan: The plan of a program.
        robot: The robot.
    """
    count = 0
    for span in plan.spans:
        if span.kind == "contour":
            yield span, Approach.of(plan.laws[:count], robot)
        count += 1 if span.trajectory is None else len(span.trajectory.laws)


def memory(robot: Robot) -> float:
    """Time after which a motion has no effect on the servo or the compensator any more [s]."""
    box, servo = robot.box, robot.servo
    dof = robot.arm.dof
    gains = np.zeros((2, dof)) if box is None else np.broadcast_to(box.gains, (2, dof))
    late = servo.dead_time
    slow = servo.replace(
        kp=servo.kp * (1 - gains[0]),
        kv=None if servo.kv is None else servo.kv * (1 - gains[1]),
    )
    rates = [slow.slowest]
    if servo.has_feedforward:
        # The compensator undoes feed-forward with a transient of its own.
        rates.append(1 / float(servo.lead[0].max()))
    options = robot.run.compensation
    if isinstance(options, PolePlacement) and options.poles is not None:
        rates.append(float(np.abs(np.real(np.asarray(options.poles, dtype=np.complex128))).min()))
    if box is not None:
        late = late + _checks.per_joint("dead_time of the box", box.dead_time, dof, "s")
    return FORGOTTEN / min(rates) + float(late.max())
