"""`Lifted`: how a change of all set-points changes the whole motion, and the best such change.

"Lifted" means that a run is one vector: `x = P du`, with one entry for every joint and time.
"""

from __future__ import annotations

from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.sparse import block_array, coo_array, csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.drives import Drives, respond_along
from armcontour.geometry import Path
from armcontour.motion import TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.simulation import command_weights

# Longest time between two times of the model [s]. The rule of the response is off by about
# (w h)² / 12 at the rate w: 0.2 % at the 150 1/s of the paper's velocity loop.
LONGEST_STEP = 1e-3
# Time constants of the slowest joint after the last set-point that count as motion: 5 % is left.
AFTER = 3.0
# Penalties are powers of ten within these, so that few factors serve all runs; the search starts at
# the first one.
PENALTIES, FIRST = (-8, 6), -3


class ToolError(NamedTuple):
    """Errors of the tool over a run, as in `LearnedRun`."""

    tool_rms: float
    tool_max: float
    contour_rms: float | None
    contour_max: float | None

    @property
    def rms(self) -> float:
        """The error by which runs are compared [m]."""
        return self.tool_rms if self.contour_rms is None else self.contour_rms


class Nominal(NamedTuple):
    """The nominal robot of which a lifted model is made, with fields as those of `Drives`.

    With masses, and a servo of order "second", rigid bodies respond, else the servos alone.
    """

    arm: Arm
    servo: ServoModel
    gravity_feedforward: bool = True
    known: Arm | None = None

    @property
    def drives(self) -> Drives | None:
        """The drives that move rigid bodies; None if the servos alone respond."""
        moved = self.arm.has_bodies and self.servo.kv is not None
        return Drives(**self._asdict()) if moved else None


class Lifted:
    """The lifted response of the nominal closed loop along a plan.

    The joints rest in equilibrium at the first set-point.

    Args:
        taught: Set-points; their times and plan count, not their values.
        nominal: The nominal robot.
        t: Regular times of the plan [s], (n,); by default at most 1 ms apart.

    Attributes:
        t: Regular times of the plan [s], (n,).
        planned: Planned joint positions at these times [rad], (n, dof).

    Raises:
        InvalidInput: The motion is too long, or the gains do not fit the arm.
    """

    def __init__(self, taught: TaughtData, nominal: Nominal, t: FloatArray | None = None) -> None:
        self.plan = taught.trajectory
        self.period, self.start = taught.period, taught.start_time
        self.count, self.dof = taught.q.shape
        if t is None:
            parts = int(np.ceil(self.period / LONGEST_STEP * (1 - 1e-9)))
            rest = float(nominal.servo.dead_time.max()) + AFTER / float(nominal.servo.kp.min())
            intervals = self.count - 1 + int(np.ceil(rest / self.period))
            t = taught.times(intervals * parts + 1, self.period / parts)
        self.t, self.step = t, float(t[1] - t[0])
        _checks.refuse_too_many(
            f"Learning {t[-1] - t[0]:.4g} s of motion, {len(t)} times,",
            len(t) * self.dof**2,
            "learn contour by contour or at a higher speed",
        )
        self.nominal, self.planned = nominal, self.plan.with_rests(t)
        q, dq, ddq = self.plan.motion_with_rests(t)
        dq[0] = ddq[0] = 0.0
        self._needed = (nominal.drives or nominal.servo).command(q, dq, ddq)
        # The equations of x by the command: `A x = S c`, in units of the command.
        response = respond_along(self.plan.with_rests, t, **nominal._asdict())
        left, right = response.equations()
        # The first rows of `equations` let the joints start where the plan does; here they start
        # in equilibrium at the first set-point.
        joints = np.arange(self.dof)
        first = response.stiffness[0] - np.eye(self.dof)
        where = np.repeat(joints, self.dof), np.tile(joints, self.dof)
        left = left + coo_array((first.ravel(), where), shape=left.shape)
        right = right + coo_array((np.ones(self.dof), (joints, joints)), shape=right.shape)
        gain = np.tile(response.gain, len(t))
        self._left = csc_array(diags_array(1 / gain) @ left)
        self._by_command = csc_array(diags_array(1 / gain) @ right @ diags_array(gain))
        self._solve = splu(self._left, permc_spec="NATURAL")
        self._weights = self._weights_at()
        self._right = csc_array(self._by_command @ self._weights)
        self._factors: dict[float, tuple[Any, Any]] = {}

    def _weights_at(self, shift: float = 0.0) -> csc_array:
        """Weights of the set-points in the command that reaches the drives, with feed-forward."""
        kind = self.nominal.servo.interpolation
        a, b = (np.tile(x, len(self.t)) for x in self.nominal.servo.lead)
        found = self._interpolated(kind, shift)
        if a.any():
            found = found + diags_array(a) @ self._rates_at(shift)
        if b.any():
            late, span = (0.0, self.period) if kind == "linear" else (self.step / 2, self.step)
            change = self._rates_at(shift + late) - self._rates_at(shift + late - span)
            found = found + diags_array(b / span) @ change
        return csc_array(found)

    def _rates_at(self, shift: float) -> csc_array:
        """Weights of the set-points in the velocity of the command, mean over one step [1/s].

        For interpolation "step" it is the velocity of the line one interval before.
        """
        kind, half = self.nominal.servo.interpolation, self.step / 2
        if kind == "step":
            kind, shift = "linear", shift - self.period
        after, before = (self._interpolated(kind, shift + x) for x in (half, -half))
        return csc_array((after - before) / self.step)

    def _interpolated(self, kind: str, shift: float) -> csc_array:
        """Weights of the set-points in the delayed command without feed-forward."""
        at = (self.t[:, None] - self.start - self.nominal.servo.dead_time + shift).ravel()
        index, weight = command_weights(self.count, self.period, kind, at)
        columns = index * self.dof + np.arange(at.size)[:, None] % self.dof
        where = np.repeat(np.arange(at.size), index.shape[1]), columns.ravel()
        shape = at.size, self.count * self.dof
        return csc_array(coo_array((weight.ravel(), where), shape=shape))

    def rates(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities of the command: of the set-points, and with feed-forward [rad/s], (n, dof).

        Args:
            q: Set-points [rad], (count, dof).
        """
        plain = (self._rates_at(0.0) @ q.ravel()).reshape(self.planned.shape)
        after, before = (self.reaching(q, x * self.step / 2) for x in (1, -1))
        return plain, (after - before) / self.step

    def respond(self, change: FloatArray) -> FloatArray:
        """Change of the joints by a change of the set-points [rad], (n, dof).

        Args:
            change: Change of the set-points [rad], (count, dof).
        """
        return self.respond_to(self.reaching(change))

    def reaching(self, change: FloatArray, shift: float = 0.0) -> FloatArray:
        """The change of the command that reaches the drives at the times [rad], (n, dof).

        Args:
            change: Change of the set-points [rad], (count, dof).
            shift: Added to the times [s].
        """
        weights = self._weights_at(shift) if shift else self._weights
        return np.asarray((weights @ change.ravel()).reshape(self.planned.shape))

    def respond_to(self, command: FloatArray) -> FloatArray:
        """Change of the joints by a change of the command that reaches the drives [rad].

        Args:
            command: Change of the command at the times [rad], (n, dof) or (n, dof, cases).
        """
        cases = command.reshape(len(self.t) * self.dof, -1)
        return np.asarray(self._solve.solve(self._by_command @ cases)).reshape(command.shape)

    def expected(self, q: FloatArray) -> FloatArray:
        """Joint positions of the nominal robot at the times for set-points [rad], (n, dof).

        Args:
            q: Set-points [rad], (count, dof).
        """
        return self.planned + self.respond_to(self.reaching(q) - self._needed)

    def correct(self, error: FloatArray, penalty: float) -> tuple[FloatArray, FloatArray]:
        """The change of the set-points that takes an error away, and the joints' response to it.

        It minimises `|error + P du|² + penalty |L du|²`, L being differences of set-points that
        follow each other.

        Args:
            error: Errors of the joints at the times [rad], (n, dof) or (n, dof, cases).
            penalty: Squared ratio of the noise to the differences of set-points.

        Returns:
            Changes of the set-points [rad], (count, dof) or (count, dof, cases), and of the joints.
        """
        solver, order = self._factored(penalty)
        rows, cases = len(self.t) * self.dof, error.shape[2:]
        right = np.zeros((len(order), *cases))
        right[:rows] = -error.reshape(rows, *cases)
        found = np.empty_like(right)
        found[order] = solver.solve(right[order])
        change = found[rows : rows + self.count * self.dof]
        return change.reshape(self.count, self.dof, *cases), found[:rows].reshape(error.shape)

    def smooth(self, error: FloatArray, penalty: float) -> FloatArray:
        """The part of an error that a disturbance of the drives explains [rad], (n, dof).

        Args:
            error: Errors of the joints at the times [rad], (n, dof).
            penalty: As in `correct`.
        """
        return -self.correct(error, penalty)[1]

    def _factored(self, penalty: float) -> tuple[Any, Any]:
        """The factors of the optimality conditions, in the order of time, and that order.

        The conditions are those of a minimum over du and x with the multipliers of `A x = B du`.
        """
        if penalty not in self._factors:
            n, size = len(self.t) * self.dof, self.count * self.dof
            jump = eye_array(size - self.dof, size, k=self.dof) - eye_array(size - self.dof, size)
            blocks: Any = [
                [eye_array(n), None, self._left.T],
                [None, penalty * (jump.T @ jump), -self._right.T],
                [self._left, -self._right, None],
            ]
            conditions = csc_array(block_array(blocks))
            moments = np.repeat(self.t, self.dof)
            taught = np.repeat(self.start + np.arange(self.count) * self.period, self.dof)
            part = self.step / 3
            times = np.concatenate([moments, taught + part, moments + 2 * part])
            order = np.argsort(times, kind="stable")
            ordered = csc_array(conditions[order][:, order])
            self._factors[penalty] = splu(ordered, permc_spec="NATURAL"), order
        return self._factors[penalty]

    def choose_penalty(self, error: FloatArray, variance: float) -> float:
        """The power of ten that explains an error best, with which noise is not learned.

        Args:
            error: Errors of the joints [rad], (n, dof).
            variance: Variance of the noise in them [rad²].
        """
        surprise = cache(lambda k: self.surprise(error, 10.0**k, max(variance, 1e-300)))
        power, last = FIRST, None
        while power != last:
            last = power
            around = range(max(power - 1, PENALTIES[0]), min(power + 1, PENALTIES[1]) + 1)
            power = min(around, key=surprise)
        return float(10.0**power)

    def surprise(self, error: FloatArray, penalty: float, variance: float) -> float:
        """How improbable an error is, as -2 log of its probability density, but for a constant.

        The error is that of set-points whose differences are normal with the variance
        `variance / penalty`, and white noise.

        Args:
            error: Errors of the joints at the times [rad], (n, dof).
            penalty: As in `correct`.
            variance: Variance of the noise [rad²].
        """
        change, response = self.correct(error, penalty)
        left = np.sum((error + response) ** 2) + penalty * np.sum(np.diff(change, axis=0) ** 2)
        factors, _order = self._factored(penalty)
        # The determinant is that of `P'P + penalty L'L` but for a factor that does not change.
        size = float(np.log(np.abs(factors.U.diagonal())).sum())
        rank = (self.count - 1) * self.dof
        return float(left / variance + size - rank * np.log(penalty))

    def equivalent_command(self, error: FloatArray) -> FloatArray:
        """The change of the command that reaches the drives and explains an error [rad], (n, dof).

        It is a mean over neighbouring times, with the weights 1/4, 1/2 and 1/4.

        Args:
            error: Errors of the joints at the times [rad], (n, dof).
        """
        return np.asarray((self._left @ error.ravel()).reshape(error.shape))

    def between(self, t: FloatArray, values: FloatArray) -> FloatArray:
        """Values at the model's times, at other times, (m, dof); constant before and after them.

        Args:
            t: Times of the plan [s], (m,).
            values: Values at the model's times, (n, dof).
        """
        return np.asarray(CubicSpline(self.t, values)(np.clip(t, self.t[0], self.t[-1])))

    def at_times(self, t: FloatArray, q: FloatArray, expected: FloatArray) -> FloatArray:
        """Joint positions at the model's times, of joint positions at other times [rad], (n, dof).

        Their difference from what is expected is interpolated, which is smoother than the motion.
        Before and after the samples it is constant.

        Args:
            t: Times of the plan [s], (m,).
            q: Joint positions [rad], (m, dof).
            expected: Expected joint positions at the model's times [rad], (n, dof).
        """
        difference = q - self.between(t, expected)
        return expected + np.asarray(CubicSpline(t, difference)(np.clip(self.t, t[0], t[-1])))

    def judge(self, error: FloatArray) -> ToolError:
        """Errors of the tool that errors of the joints make.

        A path is judged from its first set-point to the end of the times, contours of a program
        while the process is at work on them. The tool's place on the path is the nearest one.

        Args:
            error: Errors of the joints [rad], (n, dof).
        """
        planned, tool = (self.nominal.arm.forward(self.planned + x) for x in (0.0, error))
        off = np.linalg.norm(tool - planned, axis=1)
        found = [path.project(tool[which]).distance for path, which in self._paths]
        if not found:
            return ToolError(rms(off), float(off.max()), None, None)
        contour = np.concatenate(found)
        return ToolError(rms(off), float(off.max()), rms(contour), float(contour.max()))

    @cached_property
    def _paths(self) -> list[tuple[Path, IntArray]]:
        """The paths of the plan, and which times belong to each; empty if one has no path."""
        plan = self.plan
        if not plan.spans:
            return [] if plan.path is None else [(plan.path, np.arange(len(self.t)))]
        found: list[tuple[Path, IntArray]] = []
        for span in plan.contour_spans:
            if span.trajectory is None or span.trajectory.path is None:
                return []
            start, end = span.work or span.t
            which = np.flatnonzero((self.t >= start) & (self.t <= end))
            found.append((span.trajectory.path, which))
        return [x for x in found if len(x[1])]


def rms(values: FloatArray) -> float:
    """Root mean square of values."""
    return float(np.sqrt(np.mean(values**2)))
