"""`Lifted` responds linearly to a change of all set-points, and finds the best change."""

# "Lifted" means that a run is one vector, with one entry for every joint and time: x = P du, where
# x is the change of the joint positions and du is the change of the set-points.

from __future__ import annotations

from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from armcontour.control.learning.banded_conditions import (
    LAST_PENALTY,
    BandedConditions,
    Factorization,
    Weights,
)
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import interpolate
from armcontour.motion import SetPoints
from armcontour.motion.log_checks import GAP
from armcontour.robot import Arm
from armcontour.robot.nominal_robot import Drives, respond_along
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import without_integral
from armcontour.robot.servo.simulation import command_weights
from armcontour.verification.contour_errors import REST_SPEED

# Longest time step of the model [s]. The relative error of the response is about (w h)² / 12 at the
# angular frequency w and the step h, 0.2 % at the 150 1/s of the paper's velocity loop.
LONGEST_STEP = 1e-3
# Modelled time after the last set-point, in addition to the dead time [time constants of the
# slowest joint]. In this time, a response decays to 5 %.
SETTLING = 3.0
# The arm rests if its joints have not moved for this time [s].
REST_TIME = 0.1
# Set-points that reach the arm at rest do not change, so errors in the last REST_TIME of the model
# count as if they lasted for this time [s].
HELD_TIME = 10.0
# Smallest and largest exponent of a penalty. Penalties are powers of ten, so that all runs need
# only few factorizations.
PENALTIES = (-8, 6)
# Initial penalty.
FIRST_PENALTY = 1e-3
# Number of iterations that estimate deviations in gaps of a log.
BRIDGE_ITERATIONS = 10
# Relative error of the model that the estimate in gaps of a log assumes.
BRIDGE_ERROR = 1e-3
# Number of cached factorizations; the final step of a search for the penalty compares three, and
# the correction with a given last set-point requires one more.
MAX_FACTORS = 4
# Memory that learning takes per joint and time of the model, from measurements [bytes].
BYTES_PER_VALUE = 350.0
# Memory that learning takes besides, mostly for factors that are kept [bytes].
CONSTANT_BYTES = 0.8e9
# Largest memory that learning may take [bytes].
MAX_BYTES = 8e9
# Names of the models.
RIGID_BODIES = "rigid bodies"
INDEPENDENT_SERVOS = "independent servos"
IDENTIFIED_SERVOS = "independent servos identified from the first log"


class ToolError(NamedTuple):
    """Errors of the tool over a run [m], see `LearningRun`."""

    tool_rms: float
    tool_max: float
    contour_rms: float | None
    contour_max: float | None

    @property
    def rms(self) -> float:
        """RMS error by which runs are compared [m]: contour error, or tool error without a path."""
        return self.tool_rms if self.contour_rms is None else self.contour_rms


class RestError(NamedTuple):
    """Largest errors of the tool at rest after a run [m]."""

    tool: float  # Distance from the end of the plan
    contour: float | None  # Distance from the path; None if the plan has no path


class Nominal(NamedTuple):
    """The nominal robot of a lifted model, with the fields of `Drives`."""

    # The model is rigid bodies with drives if the arm has masses and all servos are of order
    # "second", otherwise independent servos.

    arm: Arm
    servo: ServoModel
    gravity_feedforward: bool = True

    @property
    def drives(self) -> Drives | None:
        """The drives that move the rigid bodies; None for a model of independent servos."""
        has_drives = self.arm.has_bodies and self.servo.is_plain("second")
        return Drives(**self._asdict()) if has_drives else None

    @property
    def model(self) -> str:
        """RIGID_BODIES or INDEPENDENT_SERVOS."""
        return INDEPENDENT_SERVOS if self.drives is None else RIGID_BODIES

    def without_bodies(self) -> Nominal:
        """Return the nominal robot whose joints move independently, as their servos."""
        chain = self.arm.chain.replace(masses=None)
        return self._replace(arm=self.arm._copy(chain=chain))


class _Term(NamedTuple):
    """A term of the command: a factor, common or per joint, times set-points at t + shift [s]."""

    # integrated: False for acceleration feed-forward, which is not an input of the integrators.

    factor: FloatArray | float
    interpolation: str
    shift: float
    integrated: bool = True


class Lifted:
    """The lifted response of the nominal closed loop, linearized along a plan."""

    # The joints rest in equilibrium at the first set-point. Only times and plan of the set-points
    # are used, not their values. t: uniform times of the plan, at most 1 ms apart [s], (n,); their
    # number may be specified. planned: planned joint positions at these times [rad], (n, dof).

    def __init__(self, set_points: SetPoints, nominal: Nominal, times: int = 0) -> None:
        self.plan = set_points.trajectory
        self.cycle = set_points.cycle
        self.start = set_points.start_time
        self.count, self.dof = set_points.q.shape
        parts = int(np.ceil(self.cycle / LONGEST_STEP * (1 - 1e-9)))
        settling = float(nominal.servo.dead_time.max()) + SETTLING / float(nominal.servo.kp.min())
        intervals = self.count - 1 + int(np.ceil(settling / self.cycle))
        step = self.cycle / parts
        drive_cycle = nominal.servo.drive_cycle
        # Drives update once per drive cycle, so a drive cycle that is not short is the time step.
        step = drive_cycle if drive_cycle > LONGEST_STEP / 2 else step
        count = times or int(np.ceil(intervals * self.cycle / step - 1e-9)) + 1
        _check_memory(count * self.dof, step * count)
        t = set_points.times(count, step)
        self.t = t
        self.step = float(t[1] - t[0])
        self.nominal = nominal
        drives = nominal.drives
        self.planned, dq, ddq = self.plan.motion_with_rests(t)
        if nominal.servo.drive_cycle:
            ddq = self.plan.motion_with_rests(t + nominal.servo.drive_cycle / 2)[2]
        dq[0] = ddq[0] = 0.0
        self._prompt = nominal.servo.without_feedforward().for_joints(self.dof)
        if drives:
            self._needed = drives.command(self.planned, dq, ddq, self.step)
        else:
            ddq = without_integral(dq, ddq, self._prompt, self.step)
            self._needed = self._prompt.command(self.planned, dq, ddq)
        # The last set-point is held, so errors at rest count as if they lasted for HELD_TIME.
        self.is_rest = t > t[-1] - REST_TIME
        self.weight = np.where(self.is_rest, HELD_TIME / REST_TIME, 1.0)[:, None]
        response = respond_along(self.plan.with_rests, t, **nominal._asdict())
        sent = self.start + np.arange(self.count)[:, None] * self.cycle
        reached = sent + nominal.servo.dead_time
        self._groups = [
            BandedConditions(response, x, self._command_weights, self.weight[:, 0], reached)
            for x in response.groups
        ]
        self._factors: dict[tuple[float, bytes], list[Factorization]] = {}
        self._penalty = FIRST_PENALTY
        self._expected = self.planned
        self._expected_of: FloatArray | None = None

    @property
    def prismatic(self) -> tuple[bool, ...]:
        """Whether each joint is prismatic; empty if none is."""
        arm = self.plan.arm
        return () if arm is None or arm.chain.prismatic is None else arm.chain.prismatic

    @cached_property
    def _terms(self) -> list[_Term]:
        """Return the terms of the command at the drives, including feed-forward."""
        servo = self.nominal.servo
        terms = [_Term(1.0, self.nominal.servo.interpolation, 0.0)]
        a, b = servo.lead
        if a.any():
            terms += self._rate_terms(a, 0.0)
        if b.any():
            linear = servo.interpolation == "linear"
            shift, span = (0.0, self.cycle) if linear else (self.step / 2, self.step)
            shift, span = (0.0, servo.drive_cycle) if servo.drive_cycle else (shift, span)
            bends = self._rate_terms(b / span, shift)
            bends += self._rate_terms(-b / span, shift - span)
            terms += [x._replace(integrated=False) for x in bends]
        return terms

    def _rate_terms(self, factor: FloatArray | float, shift: float) -> list[_Term]:
        """Return terms for the command's mean velocity over one step, times a factor."""
        kind = self.nominal.servo.interpolation
        drive_cycle = self.nominal.servo.drive_cycle
        # For interpolation "step", the velocity is that of linear interpolation one interval
        # earlier. Drives with a cycle use the difference from the command of the previous cycle.
        if kind == "step" and not drive_cycle:
            kind = "linear"
            shift = shift - self.cycle
        span = drive_cycle or self.step
        return [
            _Term(x * factor / span, kind, shift - drive_cycle / 2 + x * span / 2) for x in (1, -1)
        ]

    def _command_weights(self, joint: int, times: IntArray) -> list[Weights]:
        """Return the weights of the set-points in a joint's command at times with indices."""
        since_reached = self.t[times] - self.start - self.nominal.servo.dead_time[joint]
        parts = []
        for term in self._terms:
            factor = float(np.broadcast_to(term.factor, self.dof)[joint])
            index, weight = command_weights(
                self.count, self.cycle, term.interpolation, since_reached + term.shift
            )
            parts.append(Weights(index, factor * weight, term.integrated))
        return parts

    def _command(self, q: FloatArray) -> FloatArray:
        """Return the command at the drives for set-points, or for their change [rad], (n, dof)."""
        integrated = np.zeros(self.planned.shape)
        unseen = np.zeros(self.planned.shape)
        for j in range(self.dof):
            for indices, weights, is_integrated in self._command_weights(j, np.arange(len(self.t))):
                command = integrated if is_integrated else unseen
                command[:, j] += (weights * q[indices, j]).sum(axis=1)
        # An equivalent command replaces a command that bypasses the integrators.
        unseen = without_integral(np.zeros_like(unseen), unseen, self._prompt, self.step)
        return np.asarray(integrated + unseen)

    def respond(self, change: FloatArray) -> FloatArray:
        """Return how joint positions change, (n, dof), if set-points change, (count, dof) [rad]."""
        return self._respond_to(self._command(change))

    def _respond_to(self, command: FloatArray) -> FloatArray:
        """Return how a command at the drives changes joint positions [rad], (n, dof)."""
        response = np.empty(command.shape)
        for group in self._groups:
            response[:, group.joints] = group.respond(command)
        return response

    def expected(self, q: FloatArray) -> FloatArray:
        """Return the nominal robot's joint positions with set-points q [rad], (n, dof)."""
        # Several checks of a log compare it with the motion of the same set-points.
        if q is not self._expected_of:
            self._expected = self.planned + self._respond_to(self._command(q) - self._needed)
            self._expected_of = q
        return self._expected

    def correct(
        self, error: FloatArray, penalty: float, last: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the change of set-points that removes an error, and the joints' response [rad].

        The change du minimises `W |error + P du|² + penalty |L du|²`, where W weights the times,
        and L takes differences of consecutive set-points. error (n, dof), change (count, dof).

        - `penalty`: noise variance divided by the variance of set-point differences.
        - `last`: given change of the last set-point [rad], (dof,), nan for joints whose change is
          free; None if all are free.
        """
        held = np.full(self.dof, False) if last is None else np.isfinite(last)
        given = np.zeros(self.dof) if last is None else np.where(held, last, 0.0)
        change = np.empty((self.count, self.dof))
        response = np.empty(error.shape)
        for factorization in self._factored(penalty, held):
            group = factorization.conditions
            right_side = group.right_side(error)
            tail = np.append(np.zeros(len(group.joints)), -LAST_PENALTY * given[group.joints])
            change[:, group.joints] = factorization.solve(right_side, tail)
            response[:, group.joints] = group.response_to(right_side, error)
        return change, response

    def smooth(self, error: FloatArray, penalty: float) -> FloatArray:
        """Return the part of an error that a disturbance of the drives explains [rad], (n, dof)."""
        return -self.correct(error, penalty)[1]

    def _factored(self, penalty: float, held: BoolArray) -> list[Factorization]:
        """Return the factorizations of the optimality conditions by group of joints.

        `held` is the mask of the joints whose change of the last set-point is given, (dof,).
        """
        key = penalty, held.tobytes()
        if key not in self._factors:
            while len(self._factors) >= MAX_FACTORS:
                del self._factors[next(iter(self._factors))]
            self._factors[key] = [Factorization(x, penalty, held) for x in self._groups]
        return self._factors[key]

    def choose_penalty(self, error: FloatArray, variance: float) -> float:
        """Choose the power of ten as penalty with which an error, (n, dof), is most likely.

        The error is in rad. The search starts at the last chosen penalty. `variance` is the
        variance of the white noise [rad²].
        """
        surprise = cache(
            lambda k: self.negative_log_likelihood(error, 10.0**k, max(variance, 1e-300))
        )
        power = round(np.log10(self._penalty))
        last = None
        while power != last:
            last = power
            around = range(max(power - 1, PENALTIES[0]), min(power + 1, PENALTIES[1]) + 1)
            power = min(around, key=surprise)
        self._penalty = float(10.0**power)
        return self._penalty

    def negative_log_likelihood(self, error: FloatArray, penalty: float, variance: float) -> float:
        """Return -2 log p of an error [rad], (n, dof), with its density p, up to a constant.

        Model of the error: white noise with the variance `variance` [rad²] plus the response to
        set-points whose differences are normal with the variance `variance / penalty`.
        """
        # At the minimum, `W |error + P du|² + penalty |L du|²` is the product of the right side
        # and the multipliers.
        squares = 0.0
        # Log determinant of `P'P + penalty L'L` (see `correct`), up to a constant.
        size = 0.0
        for factorization in self._factored(penalty, np.full(self.dof, False)):
            group = factorization.conditions
            tail = np.zeros(2 * len(group.joints))
            squares += factorization.forward(group.right_side(error), tail)
            size += factorization.log_determinant
        rank = (self.count - 1) * self.dof
        return float(squares / variance + size - rank * np.log(penalty))

    def interpolate_at(self, t: FloatArray, values: FloatArray) -> FloatArray:
        """Interpolate values at the model's times to the times t, (m, dof); constant outside."""
        return np.asarray(CubicSpline(self.t, values)(np.clip(t, self.t[0], self.t[-1])))

    def fill_gaps(self, t: FloatArray, deviation: FloatArray, noise: FloatArray) -> FloatArray:
        """Return deviations at the model's times [rad], (n, dof), from those at a log's times t.

        In gaps of the log, deviations are estimated by expectation maximization with the model.

        `noise` is the standard deviation of white noise in the deviations [rad], (dof,).
        """
        bridged = np.asarray(CubicSpline(t, deviation)(np.clip(self.t, t[0], t[-1])))
        after = np.clip(np.searchsorted(t, self.t), 1, len(t) - 1)
        wide = np.diff(t)[after - 1] > GAP * np.median(np.diff(t))
        missing = wide & (self.t > t[0]) & (self.t < t[-1])
        if not missing.any():
            return bridged
        bridged[missing] = interpolate(self.t[missing], t, deviation)
        variance = max(float(np.mean(noise**2)), BRIDGE_ERROR**2 * float(np.mean(bridged**2)))
        penalty = self.choose_penalty(bridged, variance)
        for _ in range(BRIDGE_ITERATIONS):
            bridged[missing] = self.smooth(bridged, penalty)[missing]
        return bridged

    def measure_tool_error(self, error: FloatArray) -> ToolError:
        """Return the tool's errors due to errors of the joints [rad], (n, dof)."""
        # Root mean squares of a single path end when the tool comes to rest, as in `evaluate`;
        # largest errors include the rest. Contours of a program are evaluated while the process is
        # on. Contour errors are distances to the nearest point of the path.
        planned, tool = (self.nominal.arm.tool_position(self.planned + x) for x in (0.0, error))
        deviations = np.linalg.norm(tool - planned, axis=1)
        speed = np.linalg.norm(np.gradient(tool, self.step, axis=0), axis=1)
        end = int(np.flatnonzero((self.t <= self.plan.duration) | (speed > REST_SPEED))[-1]) + 1
        tool_errors = rms(deviations[:end]), float(deviations.max())
        if self.plan.path is not None:
            distances = [self.plan.path.project(tool).distance]
        else:
            paths = self.plan.paths_at(self.t)
            distances = [path.project(tool[samples]).distance for path, samples in paths]
        if not distances:
            return ToolError(*tool_errors, None, None)
        contour = np.concatenate(distances)
        moving = contour if self.plan.path is None else contour[:end]
        return ToolError(*tool_errors, rms(moving), float(contour.max()))

    def measure_rest(self, error: FloatArray) -> RestError:
        """Return the tool's largest errors at rest due to errors of the joints [rad], (n, dof)."""
        end = self.planned[-1]
        planned = self.nominal.arm.tool_position(end[None])
        tool = self.nominal.arm.tool_position(end + error)
        largest = float(np.linalg.norm(tool - planned, axis=1).max())
        if self.plan.path is None:
            return RestError(largest, None)
        return RestError(largest, float(self.plan.path.project(tool).distance.max()))


def _check_memory(values: int, duration: float) -> None:
    """Raise InvalidInput if learning would take more than MAX_BYTES of memory.

    - `values`: number of joints times number of times of the model.
    - `duration`: modelled time [s].
    """
    needed = CONSTANT_BYTES + BYTES_PER_VALUE * values
    if needed > MAX_BYTES:
        raise InvalidInput(
            f"Learning {duration:.4g} s of motion would take {needed / 1e9:.3g} GB of memory, but "
            f"may take at most {MAX_BYTES / 1e9:g} GB. Divide the job, and learn each part, or "
            "move faster.",
            limit="memory",
            needed=needed,
            allowed=MAX_BYTES,
        )


def rms(values: FloatArray) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.mean(values**2)))
