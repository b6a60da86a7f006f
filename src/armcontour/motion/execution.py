"""Set-points of the joints, and their executed motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import numpy as np

from armcontour.core import checks
from armcontour.core._quintics import evaluate, quintic
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.describing import (
    count_noun,
    draw,
    format_table,
    joint_rows,
    short_repr,
    to_html,
)
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.quantities import Axes, Quantity, Time
from armcontour.core.render import number
from armcontour.motion.trajectory import Trajectory, to_columns
from armcontour.robot import Arm, Limits

# A plant's motion ends at a result if it is as near to it as this [rad].
SAME = 1e-9
# Times are whole numbers of steps if they are so near to them [steps].
WHOLE = 1e-3
# The start of the plan counts as a set-point's time if they differ by less than this fraction of a
# cycle.
WHOLE_CYCLES = 1e-9
# Smallest and largest cycle [s]: shorter ones come near rounding errors of times; longer
# ones say nothing about the motion between set-points.
INTERVALS = (1e-6, 1.0)
# Time between the samples of a plan in place of an execution [s], and their largest number.
PLANNED_STEP, MOST_PLANNED = 1e-3, 20_000
# No controller takes set-points more slowly [s]; industrial ones take them every 1 to 40 ms.
LONGEST_CLOCK = 0.1


class Between(Protocol):
    """What knows the motion between the results of an execution: a plant."""

    def motion_between(self, executed: Execution, which: IntArray) -> FineMotion | None:
        """The motion from some results to the next ones; None where it is not known."""


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution(Checked):
    """Motion of the joints of a plant, from the first set-point until rest.

    Args:
        arm: The arm that moved.
        set_points: The set-points that the plant executed.
        t: Regular times [s], (n,).
        q, dq, ddq: Joint positions, velocities and accelerations [rad, rad/s, rad/s²], (n, dof).
        demand: Accelerations that the servos demand, before saturation [rad/s²], (n, dof).
        demand_range: Lowest and highest demand at any time, not only at `t` [rad/s²], (2, dof).
        saturated_time: Time in saturation of each joint [s], (dof,).
        torque: Torques of the drives [N m], (n, dof); None from a plant without torques.
        torque_demand: Torques before saturation [N m], (n, dof); None without `torque`.
        motor_q: Positions of the motors, which is what encoders tell [rad], (n, dof), where springs
            are between motors and links; None where they are those of the links, q.
        unsettled: Distances of the joints from the last set-point at the end [rad], (dof,), where
            they are not at rest there; None where they are.
        model_error: Largest error of each joint that the servo model of the plant does not explain
            [rad], (dof,); None if it is not known.
        plant: What tells the motion between the times `t`, so that `evaluate` finds peaks there;
            None where only the results are known, as those of a log, or of changed arrays.

    Raises:
        InvalidInput: Only one of `torque` and `torque_demand` is given.
    """

    arm: Arm
    set_points: SetPoints
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    demand: FloatArray
    demand_range: FloatArray
    saturated_time: FloatArray
    torque: FloatArray | None = None
    torque_demand: FloatArray | None = None
    motor_q: FloatArray | None = None
    unsettled: FloatArray | None = None
    model_error: FloatArray | None = None
    plant: Between | None = None

    def _check_together(self) -> None:
        if (self.torque is None) != (self.torque_demand is None):
            raise InvalidInput("An execution has both torque and torque_demand, or neither.")

    def __str__(self) -> str:
        """How every joint moved: ranges, and largest amounts."""
        t, step = self.t, float(self.t[-1] - self.t[0]) / max(len(self.t) - 1, 1)
        title = (
            f"Execution of {self.arm.name}: t = {number(t[0], 's')} to {number(t[-1], 's')}, "
            f"{len(t)} samples every {number(step, 's')}"
        )
        header = ["joint", "position [rad]", "velocity [rad/s]"]
        header += ["acceleration [rad/s²]", "saturated"]
        amounts = [self.dq, self.ddq]
        if self.torque is not None:
            header.append("torque [N m]")
            amounts.append(self.torque)
        rows = [header]
        for j, name in enumerate(self.arm.joint_names):
            low, high = self.q[:, j].min(), self.q[:, j].max()
            velocity, acceleration, *torque = (f"{np.abs(x[:, j]).max():.4g}" for x in amounts)
            held = number(self.saturated_time[j], "s")
            reach = f"{low:z.4f} to {high:z.4f}"
            rows.append([name, reach, velocity, acceleration, held, *torque])
        return format_table(title, rows, columns=">")

    __repr__ = short_repr

    _repr_html_ = to_html
    figure = draw

    def to_dict(self) -> dict[str, FloatArray]:
        """Results as columns that `pandas.DataFrame` takes, as of `Trajectory.to_dict`.

        pandas.DataFrame(executed.to_dict()).plot(x="t", y="q1")
        """
        return to_columns(self)

    @classmethod
    @checked
    def of_plan(cls, trajectory: Trajectory, arm: Arm) -> Execution:
        """The motion of joints that follow a plan exactly.

        Args:
            trajectory: The plan.
            arm: Its arm.
        """
        cycle = max(PLANNED_STEP, trajectory.duration / MOST_PLANNED)
        samples = trajectory.sample(cycle)
        set_points = SetPoints(cycle=cycle, q=samples.q, trajectory=trajectory, method="none")
        return cls(
            arm=arm,
            set_points=set_points,
            t=samples.t,
            q=samples.q,
            dq=samples.dq,
            ddq=samples.ddq,
            demand=samples.ddq,
            demand_range=np.stack([samples.ddq.min(axis=0), samples.ddq.max(axis=0)]),
            saturated_time=np.zeros(arm.dof),
        )

    def between(self, which: IntArray) -> FineMotion | None:
        """The motion from some results to the next ones; None where it is not known.

        The plant is believed only where results are as far from each other as it gives them, and
        its motion ends at the next ones: an execution that was cut or changed may have others.

        Args:
            which: Indices of the results before, increasing, (m,).
        """
        if self.plant is None or not self._are_steps(which):
            return None
        found = self.plant.motion_between(self, which)
        if found is None:
            return None
        off = np.abs(found(self.t[which + 1]) - self.q[which + 1])
        return found if off.max(initial=0.0) < SAME else None

    def _are_steps(self, which: IntArray) -> bool:
        """Whether some results and the next ones are at whole steps of the cycle."""
        step = float(self.t[1] - self.t[0])
        if not 0 < step < self.set_points.cycle * (1 + WHOLE):
            return False
        steps = self.set_points.cycle / step
        at = (self.t[np.stack([which, which + 1])] - self.set_points.start_time) / step
        whole = at.round()
        return bool(
            abs(steps - round(steps)) < WHOLE
            and (abs(at - whole) < WHOLE).all()
            and (whole[1] - whole[0] == 1).all()
        )

    @property
    def peak_demand(self) -> FloatArray:
        """Largest absolute demand of each joint at any time [rad/s²], (dof,)."""
        return np.asarray(np.abs(self.demand_range).max(axis=0))

    @property
    def tool(self) -> FloatArray:
        """Positions of the tool [m], (n, dimension)."""
        return self.arm.tool_position(self.q)

    @property
    def tool_speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        return np.asarray(np.linalg.norm(self.arm.tool_velocity(self.q, self.dq), axis=1))

    @property
    def saturated(self) -> BoolArray:
        """Mask of the times at which a joint is saturated, (n, dof)."""
        asked, given = self.demand, self.ddq
        if self.torque is not None and self.torque_demand is not None:
            asked, given = self.torque_demand, self.torque
        return np.asarray(np.abs(asked - given) > 1e-9 * np.abs(asked))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineMotion:
    """Joint motion as polynomials between nodes, with the velocities on both sides of each node.

    Args:
        t: Times of the nodes [s], (n,); the same time twice where one stretch ends and another
            one begins.
        q: Joint positions [rad], (n, dof).
        before: Joint velocities before each node [rad/s], (n, dof).
        after: Joint velocities after each node [rad/s], (n, dof).
        ddq: Joint accelerations, which do not jump [rad/s²], (n, dof): the polynomials are
            quintics; None for cubics.
    """

    t: FloatArray
    q: FloatArray
    before: FloatArray
    after: FloatArray
    ddq: FloatArray | None = None

    def __call__(self, t: FloatArray) -> FloatArray:
        """Joint positions at times between the nodes of a stretch [rad], (len(t), dof)."""
        nodes = self.t
        i: Any = slice(0, 1)
        if len(nodes) > 2:
            i = np.minimum(nodes[1:-1].searchsorted(t, side="right"), len(nodes) - 2)
        widths = nodes[1:] - nodes[:-1]
        if self.ddq is not None:
            begin = self.q[:-1], self.after[:-1], self.ddq[:-1]
            end = self.q[1:], self.before[1:], self.ddq[1:]
            return evaluate(quintic(widths, begin, end)[i], widths[i], t - nodes[:-1][i], 0)
        width = widths[i, None]
        x = (t[:, None] - nodes[:-1][i, None]) / width
        rise = (self.q[1:] - self.q[:-1])[i]
        first, last = width * self.after[:-1][i], width * self.before[1:][i]
        bend = first + last - 2 * rise
        rest = x * (rise - first - bend + x * bend)
        return np.asarray(self.q[:-1][i] + x * (first + rest))

    @classmethod
    def through(
        cls, t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray | None, which: IntArray
    ) -> FineMotion:
        """The motion from each of some results to the next one, by polynomials.

        Args:
            t: Times of all results [s], (n,).
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof), or None.
            which: Indices of the results before, increasing, (m,).
        """
        i = (which[:, None] + np.arange(2)).ravel()
        rate = dq[i]
        bend = None if ddq is None else ddq[i]
        return cls(t=t[i], q=q[i], before=rate, after=rate, ddq=bend)


def check_cycle(cycle: float) -> float:
    """A checked cycle [s].

    Raises:
        InvalidInput: The interval is not a number, or outside INTERVALS.
    """
    interval = checks.check_number("cycle", cycle, "s")
    if INTERVALS[1] < interval <= 1e3 * INTERVALS[1]:
        raise InvalidInput(
            f"cycle is {interval:g} s, but at most {INTERVALS[1]:g} s: a number without "
            f"a unit is in s, so for {interval:g} ms give {interval:g} ms in a job, or "
            f"{interval / 1e3:g} in Python.",
            needed=interval,
            allowed=INTERVALS[1],
        )
    return checks.check_range("cycle", interval, *INTERVALS, "s")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitCost(Checked):
    """What limits of commands cost: set-points differ from those without these limits.

    Args:
        deviation: Largest change of the set-points of each joint [rad], (dof,).
        contour_rms: RMS contour error that the changes cause by the servo model, if the set-points
            without limits cause none [m]; None if the plan knows no arm or has no path.
        contour_max: Largest such contour error [m].
    """

    deviation: FloatArray
    contour_rms: float | None = None
    contour_max: float | None = None

    def __str__(self) -> str:
        """Largest change of a set-point, and the contour error."""
        j = int(np.argmax(self.deviation))
        text = f"up to {number(self.deviation[j], 'rad')} at joint {j + 1}"
        most = self.contour_max
        return text if most is None else f"{text}, contour error {number(most, 'm')} at most"


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetPoints(Checked):
    """Joint set-points at regular times.

    Args:
        cycle: Cycle [s].
        q: Set-points [rad], (n, dof); set-point k is due k periods after the first. Before the
            first and after the last set-point the command is constant.
        trajectory: The realizable trajectory that the joints should follow.
        method: Name of the compensation method that made the set-points.
        start_time: Time of the first set-point [s], not above 0. The planned motion starts at 0;
            set-points with a time advance start before.
        truncated: Bound of each joint's error after the planned motion because the transient of its
            set-points is cut off [rad], (dof,); None if it is not.
        command_limits: Limits of the set-points themselves, as in `compensate`; None without any.
        limit_cost: Cost of these limits; None if all set-points are as without them.

    Raises:
        InvalidInput: The set-points are not finite numbers, (n, dof), the interval is outside
            INTERVALS, or the start time is above 0.
    """

    cycle: float
    q: Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
    trajectory: Trajectory
    method: str
    start_time: Time = 0.0
    truncated: FloatArray | None = None
    command_limits: Limits | None = None
    limit_cost: LimitCost | None = None

    def _check_together(self) -> None:
        check_cycle(self.cycle)
        if not len(self.q):
            raise InvalidInput("Set-points needs at least one row of set-points, one per joint.")
        if self.start_time > 0:
            raise InvalidInput(
                "start_time must not be above zero, when the plan starts, but is "
                f"{self.start_time:g} s."
            )

    def __str__(self) -> str:
        """Number and interval of the set-points, and where the joints are sent."""
        return format_table(self._title("Set-points"), self._rows)

    __repr__ = short_repr

    def _title(self, what: str) -> str:
        """What it is, with the number of set-points."""
        return f"{what}: {count_noun(len(self.q), 'set-point')} every {number(self.cycle, 's')}"

    @property
    def _rows(self) -> list[tuple[str, str]]:
        """Method, times and joint positions as names and values."""
        first, last = self.start_time, self.start_time + (len(self.q) - 1) * self.cycle
        return [
            ("compensation", self.method),
            ("times", f"{number(first, 's')} to {number(last, 's')}"),
            ("plan", number(self.trajectory.duration, "s")),
            ("command / limit", self.command_note),
            ("limits change", "" if self.limit_cost is None else str(self.limit_cost)),
            *joint_rows(self.q),
        ]

    @property
    def command_use(self) -> dict[str, FloatArray]:
        """Largest share of each command limit that set-points use, per joint, (dof,) each.

        Velocities, accelerations and jerks are differences of the set-points over the command
        interval, as controllers check them. Empty without command limits.
        """
        from armcontour.motion.nearest_commands import command_use

        if self.command_limits is None:
            return {}
        return command_use(self.q, self.cycle, self.command_limits)

    @property
    def command_note(self) -> str:
        """The largest values of `command_use`, as text; empty without command limits."""
        return ", ".join(f"{name} {use.max():.4f}" for name, use in self.command_use.items())

    @property
    def t(self) -> FloatArray:
        """Times of the set-points [s], (n,); the planned motion starts at 0."""
        return self.times(len(self.q), self.cycle)

    def times(self, count: int, step: float) -> FloatArray:
        """Regular times from the first set-point on [s], (count,).

        If the first time is a multiple of the step, all times are, without rounding errors.

        Args:
            count: Number of times.
            step: Time between two times [s].
        """
        number = np.arange(count, dtype=np.float64)
        before = self.start_time / step
        if abs(before - round(before)) < WHOLE_CYCLES:
            return np.asarray((number + round(before)) * step)
        return self.start_time + number * step
