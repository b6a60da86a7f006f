"""Fit of the servo model to the log of a run: gains, velocity feed-forward and dead time."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from armcontour.control.learning.lifted_model import Lifted
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.motion import SetPoints
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import GAINS, LONGEST_DEAD_TIME

# Time step of the response in the first, coarse fits [s].
COARSE_STEP = 4e-3
# Fitted gains are within this factor of the nominal gains, in both directions.
MAX_FACTOR = 5.0
# Velocity feed-forward: smallest value of a joint with acceleration feed-forward, and largest value
# of any joint.
MIN_FEEDFORWARD, MAX_FEEDFORWARD = 1e-3, 1.5
# Values of velocity feed-forward from which fits start, in addition to the nominal value.
STARTS = (0.0, 0.9)
# Longest increase of the dead time in the fit [s]; controllers for contouring have less.
MAX_DELAY_INCREASE = 0.05
# PRIOR: prior standard deviation of the relative changes of gains and of the changes of
# feed-forward. DELAY_PRIOR: prior standard deviation of the change of the dead time [s].
PRIOR, DELAY_PRIOR = 0.5, 0.01
# A joint is at rest if its range is below REST_NOISE times its noise or below REST_RANGE [rad].
# REST_PRIOR: prior standard deviation of the parameters of such a joint.
REST_PRIOR, REST_NOISE, REST_RANGE = 1e-6, 10.0, 1e-6
# Penalty of the coarse fits, which excludes a disturbance as an explanation of the deviations.
NO_DISTURBANCE = 1e4
# FIRST_STEPS: steps of the coarse fit from each start. ROUNDS: number of fits from the best start,
# each with a new penalty. NEXT_STEPS: steps of each of these fits.
FIRST_STEPS, ROUNDS, NEXT_STEPS = 8, 2, 20
# Damping of the Levenberg-Marquardt method, relative to the diagonal: initial and largest value.
DAMPING, MAX_DAMPING = 1e-3, 1e6
# A search ends if a step increases twice the log posterior probability by less than this.
LEAST_STEP_GAIN = 1e-1
# A fitted servo is accepted if it increases twice the log posterior by more than this per joint.
LEAST_GAIN = 20.0


def fit_servo(
    set_points: SetPoints,
    lifted: Lifted,
    error: FloatArray,
    variance: float,
    noise: FloatArray,
    interval: float,
) -> tuple[ServoModel, tuple[float, float]]:
    """Servo model that the log supports, and misfits; the nominal servo if none fits better."""
    # The deviation from the expected motion is white noise, friction of each joint, and the
    # response to an unknown disturbance, which is a random walk of the command
    # (`Lifted.negative_log_likelihood`). The penalty, which determines the size of the disturbance,
    # is estimated together with the servo.
    # error: deviation from the expected motion [rad], (n, dof), with white noise of the variance
    # `variance` [rad²]. noise: standard deviation of the measurement [rad], (dof,). interval: time
    # between samples of the log [s].
    # The misfits are the RMS deviations of the joints from the motion with the nominal servo and
    # with the fitted servo, without friction and offsets [rad]; both 0 for the nominal servo.
    # The time step of the fine fit is at least half of the interval of the log, because a shorter
    # step adds no information.
    spans = COARSE_STEP, min(interval / 2, COARSE_STEP)
    steps = [max(int(x / lifted.step * (1 + 1e-9)), 1) for x in spans]
    still = np.ptp(lifted.planned, axis=0) < np.maximum(REST_NOISE * noise, REST_RANGE)
    fits = {
        k: _ServoProblem(
            set_points,
            lifted if k == 1 else Lifted(set_points, lifted.nominal, lifted.t[::k], near=lifted),
            error[::k],
            variance,
            still,
        )
        for k in set(steps)
    }
    coarse, fit = (fits[k] for k in steps)
    few, lifted = coarse.lifted, fit.lifted
    # Starts: the nominal servo, and the nominal servo with each feed-forward of STARTS.
    dof, starts = lifted.dof, np.zeros((1 + len(STARTS), len(fit.spread)))
    starts[1:, dof : 2 * dof] = np.subtract.outer(STARTS, fit.nominal.velocity_feedforward)
    best = min((coarse.solve(x, FIRST_STEPS) for x in np.unique(starts, axis=0)), key=coarse.cost)
    # The penalty of the coarse fit is the initial penalty of the fine fit.
    before, fit.penalty = (
        0.0,
        few.choose_penalty(coarse.unexplained(best), variance, NO_DISTURBANCE),
    )
    for _ in range(ROUNDS):
        fit.penalty = lifted.choose_penalty(fit.unexplained(best), variance, fit.penalty)
        if fit.penalty == before:
            break
        before, best = fit.penalty, fit.solve(best, NEXT_STEPS)
    # The nominal servo with the most probable friction.
    alone, friction = starts[0], slice(2 * dof, 3 * dof)
    columns = fit.derivatives(alone)[:, friction]
    alone[friction] -= np.linalg.lstsq(columns, fit.residuals(alone), rcond=None)[0]
    if fit.cost(alone) - fit.cost(best) <= LEAST_GAIN * dof:
        return lifted.nominal.servo, (0.0, 0.0)
    before, after = (float(np.sqrt(fit.unexplained(x).var(axis=0).mean())) for x in (alone, best))
    return fit.servo(best), (before, after)


class _ServoProblem:
    """Least-squares problem of the servo: whitened residuals of a log, and their derivatives."""

    # Model of a joint: `q + b dq + c T = u + a du` with b = 1 / K_p, c = 1 / (K_p K_v), a = f / K_p
    # (f: velocity feed-forward) and T = torque / inertia. The parameters of each joint are the
    # changes of `K_p b` and `K_p a` (with the nominal K_p), friction and, for order "second", the
    # change of `K_p K_v c`. The last parameter is the common change of all dead times. Offsets are
    # part of the disturbance.

    def __init__(
        self,
        set_points: SetPoints,
        lifted: Lifted,
        error: FloatArray,
        variance: float,
        still: BoolArray,
    ) -> None:
        self.set_points, self.lifted = set_points, lifted
        self.measured = lifted.expected(set_points.q) + error
        self.deviation, self.penalty = float(np.sqrt(variance)), NO_DISTURBANCE
        self.nominal, self.dof = lifted.nominal.servo, lifted.dof
        spread = [PRIOR, PRIOR, np.inf, PRIOR][: 3 if self.nominal.kv is None else 4]
        each = np.where(still, REST_PRIOR, np.array(spread)[:, None])
        if self.nominal.kv is not None:
            each[3, np.isinf(self.nominal.kv)] = REST_PRIOR
        self.spread = np.append(each.ravel(), DELAY_PRIOR)
        self._last: tuple[FloatArray, Lifted, FloatArray, FloatArray] | None = None

    def servo(self, parameters: FloatArray) -> ServoModel:
        """The servo with these parameters, within the ranges of the gains."""
        b, a, _, *c = parameters[:-1].reshape(-1, self.dof)
        nominal = self.nominal
        # Acceleration feed-forward requires velocity feed-forward.
        smallest = np.where(nominal.acceleration_feedforward > 0, MIN_FEEDFORWARD, 0.0)
        # Loops with a drive cycle are unstable with gains above 1 / drive cycle.
        low, high = GAINS[0], 1 / nominal.drive_cycle if nominal.drive_cycle else GAINS[1]
        kv = nominal.kv
        if kv is not None:
            changed = np.clip(kv * (1 + b) / (1 + c[0]), low, np.maximum(kv, high))
            kv = np.where(np.isinf(kv), kv, changed)
        return nominal.replace(
            kp=np.clip(nominal.kp / (1 + b), low, np.maximum(nominal.kp, high)),
            kv=kv,
            velocity_feedforward=np.clip(
                (nominal.velocity_feedforward + a) / (1 + b), smallest, MAX_FEEDFORWARD
            ),
            dead_time=np.clip(nominal.dead_time + parameters[-1], 0.0, LONGEST_DEAD_TIME),
        )

    def response(self, parameters: FloatArray) -> tuple[Lifted, FloatArray, FloatArray]:
        """Lifted response with these parameters, expected motion, and response to friction."""
        if self._last is None or not np.array_equal(parameters, self._last[0]):
            response = self.lifted
            if parameters.any():
                nominal = response.nominal._replace(servo=self.servo(parameters))
                response = Lifted(self.set_points, nominal, response.t, near=response)
            expected = response.expected(self.set_points.q)
            self._last = parameters.copy(), response, expected, self._friction(expected)
        return self._last[1:]

    def unexplained(self, parameters: FloatArray) -> FloatArray:
        """Measured less predicted positions [rad], (n, dof); the prediction includes friction."""
        _, expected, friction = self.response(parameters)
        return np.asarray(
            self.measured - expected - friction * parameters[:-1].reshape(-1, self.dof)[2]
        )

    def _friction(self, expected: FloatArray) -> FloatArray:
        """Response to a command of 1 rad in the direction of motion, as by friction, (n, dof)."""
        speed = np.gradient(expected, self.lifted.step, axis=0)
        fastest = np.abs(speed).max(axis=0)
        direction = np.tanh(speed / np.where(fastest > 0, 1e-2 * fastest, 1.0))
        return self.lifted.respond_to(self.lifted.equivalent_input(direction))

    def whiten(self, error: FloatArray) -> FloatArray:
        """Transform deviations to independent values with the standard deviation 1, (m, cases)."""
        change, response = self.lifted.correct(error, self.penalty)
        jumps = np.sqrt(self.penalty) * np.diff(change, axis=0)
        whitened = np.concatenate([error + response, jumps]).reshape(-1, error.shape[2])
        return np.asarray(whitened / self.deviation)

    def residuals(self, parameters: FloatArray) -> FloatArray:
        """Whitened deviations, then parameters divided by their prior standard deviations, (k,)."""
        return np.append(
            self.whiten(self.unexplained(parameters)[:, :, None]), parameters / self.spread
        )

    def derivatives(self, parameters: FloatArray) -> FloatArray:
        """Derivatives of `residuals` by the parameters, (k, parameters)."""
        nominal, dof = self.nominal, self.dof
        lifted, expected, friction = self.response(parameters)
        rate, with_feedforward = lifted.command_velocities(self.set_points.q)
        dq = np.gradient(expected, lifted.step, axis=0)
        causes = [-dq / nominal.kp, rate / nominal.kp]
        if nominal.kv is not None:
            drives, ddq = lifted.drives, np.gradient(dq, lifted.step, axis=0)
            if drives is not None:
                ddq = drives.moving_torque(expected, dq, ddq) / drives.inertia
            ddq = lifted.equivalent_input(ddq)
            causes.append(-ddq / (nominal.kp * nominal.kv))
        each = [x[:, :, None] * np.eye(dof) for x in causes]
        by_delay = -with_feedforward[:, :, None]
        parts = lifted.respond_to(np.concatenate([*each, by_delay], axis=2))
        by_friction = friction[:, :, None] * np.eye(dof)
        parts = np.concatenate(
            [parts[:, :, : 2 * dof], by_friction, parts[:, :, 2 * dof :]], axis=2
        )
        return np.vstack([-self.whiten(parts), np.diag(1 / self.spread)])

    def solve(self, parameters: FloatArray, steps: int) -> FloatArray:
        """Most probable parameters, by at most `steps` steps of the Levenberg-Marquardt method."""
        smallest, largest, free = 1 / MAX_FACTOR - 1, MAX_FACTOR - 1, np.inf
        lower = np.repeat([smallest, 0.0, -free, smallest], self.dof)[: len(parameters) - 1]
        lower[self.dof : 2 * self.dof] = -self.nominal.velocity_feedforward
        upper = np.repeat([largest, MAX_FACTOR, free, largest], self.dof)[: len(parameters) - 1]
        lower = np.append(lower, -self.nominal.dead_time.min()) - 1e-9
        upper = np.append(upper, MAX_DELAY_INCREASE) + 1e-9
        residuals = self.residuals(parameters)
        cost, damping = float(residuals @ residuals), DAMPING
        for _ in range(steps):
            slope = self.derivatives(parameters)
            square, down = slope.T @ slope, slope.T @ residuals
            while damping < MAX_DAMPING:
                factor = np.linalg.cholesky(square + damping * np.diag(np.diag(square))).T
                target = -np.linalg.solve(factor.T, down)
                step = lsq_linear(factor, target, (lower - parameters, upper - parameters)).x
                if -step @ (2 * down + square @ step) < LEAST_STEP_GAIN:
                    return parameters
                there = parameters + step
                residuals = self.residuals(there)
                trial_cost = float(residuals @ residuals)
                if trial_cost < cost:
                    break
                damping *= 10
            else:
                return parameters
            gained, parameters, cost, damping = cost - trial_cost, there, trial_cost, damping / 10
            if gained < LEAST_STEP_GAIN:
                return parameters
        return parameters

    def cost(self, parameters: FloatArray) -> float:
        """-2 log of the posterior probability of the parameters, up to a constant."""
        return float(np.sum(self.residuals(parameters) ** 2))
