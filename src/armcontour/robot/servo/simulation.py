"""Simulation of joint servos: in set-point cycles, at any times, and along logs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ExecutionError
from armcontour.robot.servo.march import (
    COMPLETE,
    HELD,
    LINEAR,
    SATURATING,
    JointMotions,
    Joints,
    run_joints,
)
from armcontour.robot.servo.model import ServoModel, lead_of, sliding

# Times within this distance of a set-point, in cycles, are equal to its time.
SAME_SET_POINT_TIME = 1e-9


class ServoSimulation:
    """Simulation of all joints that follow set-points, exact between saturation events.

    Args:
        q: Set-points [rad], (n, dof).
        cycle: Time between two set-points [s].
        servo: Servo with one value per joint.
        lower: Lower acceleration bounds [rad/s²], (dof,); infinite by default.
        upper: Upper acceleration bounds [rad/s²], (dof,); infinite by default.
        steps: Number of results per interval.
    """

    def __init__(
        self,
        q: FloatArray,
        cycle: float,
        servo: ServoModel,
        lower: FloatArray | None = None,
        upper: FloatArray | None = None,
        *,
        steps: int = 1,
    ) -> None:
        self.q = q
        self.cycle = cycle
        self.servo = servo
        self.steps = steps
        free = np.full(len(servo.kp), np.inf)
        bounds = -free if lower is None else lower, free if upper is None else upper
        self.joints = _joints(servo, free, *bounds)
        command = command_pieces(q, cycle, servo.interpolation)
        if servo.drive_cycle:
            self.commands = command.plain
            return
        self.commands = add_feedforward(command, servo)
        self.starts = np.arange(len(q)) * cycle + servo.dead_time[:, None]

    def run(
        self, begin: int, end: int, q: FloatArray, dq: FloatArray, held: FloatArray | None = None
    ) -> JointMotions:
        """Simulate all joints from the start of interval `begin` to the start of `end`.

        Args:
            begin: Index of the first interval.
            end: Index of the interval at whose start the simulation ends.
            q: Initial joint positions [rad], (dof,).
            dq: Initial joint velocities [rad/s], (dof,).
            held: Values that drives with a cycle hold at first, (dof,): accelerations [rad/s²], for
                order "first" velocities, with an integrator demands.
        """
        results = np.arange(begin * self.steps, end * self.steps + 1, dtype=np.float64)
        held = np.zeros_like(q) if held is None else held
        return self.run_at(results * (self.cycle / self.steps), (q, dq, held))

    def run_at(
        self, times: FloatArray, state: tuple[FloatArray, FloatArray, FloatArray]
    ) -> JointMotions:
        """Simulate all joints as `run` does, with results at times[1:].

        Args:
            times: Increasing times [s], (m + 1,); the simulation starts at the first one.
            state: Joint positions [rad], velocities [rad/s] and held values at the start, (dof,)
                each.
        """
        kind = HELD if self.servo.drive_cycle else COMPLETE
        if kind == HELD:
            commands, starts = self._held_commands(times[0], times[-1])
        else:
            commands = self.commands
            starts = self.starts
        motions = run_joints(self.joints, kind, commands, starts, times, np.stack(state))
        if motions.stuck.any():
            j = int(np.argmax(motions.stuck))
            kv = self.servo.kv
            gains = f"kp = {self.servo.kp[j]:g}" + ("" if kv is None else f" and kv = {kv[j]:g}")
            raise ExecutionError(
                f"Joint {j + 1} cannot be simulated with {gains} 1/s and a cycle of "
                f"{self.cycle:g} s, because the time steps that the servo requires are too short. "
                "Reduce the gains.",
                joint=j,
            )
        return motions

    def velocities_after(self, t: FloatArray, q: FloatArray) -> FloatArray:
        """Return velocities just after times t [rad/s], (m, dof); NaN for order "second".

        Args:
            t: Times [s], (m,).
            q: Joint positions at these times [rad], (m, dof).
        """
        velocities = np.full(q.shape, np.nan)
        for j in np.flatnonzero(self.joints.kv == 0):
            k = np.searchsorted(self.starts[j], t + SAME_SET_POINT_TIME * self.cycle, side="right")
            moves = (k > 0) & (k < len(self.q))
            elapsed = np.where(moves, t - self.starts[j, k - 1], 0.0)
            a, b, c, d = self.commands[j, k, :4].T
            velocities[:, j] = b + elapsed * (2 * c + elapsed * 3 * d)
            if np.isfinite(self.joints.kp[j]):
                velocities[:, j] = self.joints.kp[j] * (
                    a + elapsed * (b + elapsed * (c + elapsed * d)) - q[:, j]
                )
        return velocities

    def _held_commands(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Return the drives' held commands between two times, and the cycles' start times [s]."""
        drive_cycle = self.servo.drive_cycle
        pieces = self.commands
        cycle = self.cycle
        # The initial integral follows from the previous cycle.
        first = int(np.floor(begin / drive_cycle + SAME_SET_POINT_TIME)) - 1
        count = int(np.ceil(end / drive_cycle - SAME_SET_POINT_TIME)) - first + 1
        starts = (first + np.arange(max(count, 2), dtype=np.float64)) * drive_cycle

        # Feed-forward is computed from two earlier cycles.
        times = np.asarray((first + np.arange(-2, len(starts))) * drive_cycle, np.float64)
        u = sample_command(pieces, cycle, self.servo.dead_time, times).T
        return held_pieces(u, starts, self.servo), np.tile(starts, (len(pieces), 1))


def _joints(
    servo: ServoModel | JointServo, like: FloatArray, lower: FloatArray, upper: FloatArray
) -> Joints:
    """Return gains and bounds for the compiled simulation as writable arrays, (rows,) each."""
    kv = np.broadcast_to(np.inf if servo.kv is None else servo.kv, like.shape)
    # Joints without a velocity loop do not saturate.
    loop = np.isfinite(kv)
    lower = np.where(loop, lower, -np.inf)
    upper = np.where(loop, upper, np.inf)
    kp, ki = (np.array(np.broadcast_to(x, like.shape)) for x in (servo.kp, servo.ki))
    return Joints(kp, np.where(loop, kv, 0.0), ki, lower, upper)


def held_pieces(u: FloatArray, starts: FloatArray, servo: ServoModel | JointServo) -> FloatArray:
    """Return the command pieces for `march`, including feed-forward and friction.

    A piece is one held value per drive cycle, or linear for joints that are pure delays.

    Args:
        u: Commands without feed-forward and friction at each drive cycle [rad], (rows, count + 2),
            starting two cycles before `starts`.
        starts: Start times of the drive cycles [s], (count,).
        servo: The servo.
    """
    width = starts[1] - starts[0]
    du = np.diff(u, axis=1)[:, 1:] / width
    ddu = np.diff(u, 2, axis=1) / width**2
    a, b, c = (np.broadcast_to(x, len(u))[:, None] for x in (*servo.lead, servo.friction))
    pieces = np.zeros((len(u), u.shape[1] - 1, 5))
    pieces[:, 1:, 4] = b * ddu - c * sliding(du)
    pieces[:, 1:, 0] = values = u[:, 2:] + a * du + pieces[:, 1:, 4]
    lines = np.isinf(servo.kp)
    pieces[lines, 1:-1, 1] = np.diff(values[lines], axis=1) / width
    return pieces


class MotionInInterval(NamedTuple):
    """Joint motion within one set-point interval.

    Args:
        t: Requested times, and times at which a set-point reaches a joint, in order [s], (m,).
        q: Joint positions [rad], (m, dof).
        before: Joint velocities just before each time [rad/s], (m, dof).
        after: Joint velocities just after each time [rad/s], (m, dof).
    """

    t: FloatArray
    q: FloatArray
    before: FloatArray
    after: FloatArray


def respond_within(
    q: FloatArray,
    cycle: float,
    servo: ServoModel,
    bounds: tuple[FloatArray, FloatArray],
    k: int,
    times: FloatArray,
    state: tuple[FloatArray, FloatArray, FloatArray],
) -> MotionInInterval:
    """Simulate all joints at increasing times within interval `k`.

    Args:
        q: Set-points [rad], (n, dof).
        cycle: Time between two set-points [s].
        servo: Servo with one value per joint.
        bounds: Lower and upper acceleration bounds [rad/s²], (dof,) each.
        k: Index of the interval.
        times: Increasing times [s].
        state: Positions [rad], velocities [rad/s] and held values at the first time, (dof,) each.
    """
    phase = servo.dead_time % cycle
    tolerance = SAME_SET_POINT_TIME * cycle
    times = np.union1d(
        times, phase[(phase > times[0] + tolerance) & (phase < times[-1] - tolerance)]
    )
    # Only the active set-points are simulated, with the neighbours for their interpolation.
    delay = np.floor(servo.dead_time / cycle + SAME_SET_POINT_TIME).astype(np.intp)
    first = max(min(k - int(delay.max()) - 3, len(q) - 4), 0) if not servo.drive_cycle else 0
    active_points = q[first : max(k - int(delay.min()) + 4, first + 4)]
    active = ServoSimulation(active_points, cycle, servo, *bounds)
    states = active.run_at((k - first) * cycle + times, state).states
    position, velocity = (np.vstack([x, states[:, :, i].T]) for i, x in enumerate(state[:2]))
    after = velocity.copy()
    if not servo.drive_cycle:
        jump = active.velocities_after((k - first) * cycle + times[:-1], position[:-1])
        after[:-1] = np.where(np.isnan(jump), velocity[:-1], jump)
    return MotionInInterval(times, position, velocity, after)


def follow(
    command: LoggedCommand,
    servo: JointServo,
    q0: float | FloatArray,
    dq0: float | FloatArray,
    drive_cycle: float = 0.0,
    ddq0: float | FloatArray = 0.0,
) -> FloatArray:
    """Simulate a joint that follows its log; return its positions [rad], (n,).

    The simulation is exact between the breaks of the command. If the servo has arrays, (rows,), the
    result is (rows, n). It is not finite if the time steps that the servo requires are too short.

    Args:
        command: The logged command.
        servo: The joint's servo.
        q0: Initial position [rad].
        dq0: Initial velocity [rad/s].
        drive_cycle: Time between two computations of the drive's loop [s]; 0 for a continuous loop.
            The first cycle begins at the first set-point.
        ddq0: Initial demand [rad/s²], for a servo with an integrator.
    """
    shape = np.broadcast_shapes(*(np.shape(x) for x in (*servo, q0, dq0, ddq0)))
    rows = int(np.prod(shape))
    each = JointServo(*(np.array(np.broadcast_to(x, rows), dtype=np.float64) for x in servo))
    limit = each.acceleration_limit
    joints = _joints(each, limit, -limit, limit)
    kind = LINEAR if np.isinf(limit).all() else SATURATING
    if drive_cycle:
        kind = HELD
        origin = command.knots[0]
        first = int(np.floor((command.t[0] - origin) / drive_cycle + SAME_SET_POINT_TIME))
        count = int(np.ceil((command.t[-1] - origin) / drive_cycle - SAME_SET_POINT_TIME)) + 1
        times = origin + np.arange(first - 3, count) * drive_cycle
        u = np.stack([command.evaluate(times - delay) for delay in each.dead_time])
        pieces = held_pieces(u, times[2:], each)
        starts = np.tile(times[2:], (rows, 1))
    else:
        # Set-points before the first simulated one reach the joint before the motion.
        early = command.t[0] - np.max(each.dead_time)
        first = max(int(np.searchsorted(command.knots, early)) - 1, 0)
        pieces = add_feedforward(command.pieces, each, first)
        starts = command.knots[first:] + each.dead_time[:, None]
    states = np.zeros((3, rows))
    states[0] = q0
    states[1] = dq0
    states[2] = ddq0
    motions = run_joints(joints, kind, pieces, starts, command.t, states)
    begin = np.where(np.isinf(each.kp), command.evaluate(command.t[0] - each.dead_time), states[0])
    positions = np.concatenate([begin[:, None], motions.states[:, :, 0]], axis=1)
    return np.asarray(positions.reshape(*shape, -1))


class JointServo(NamedTuple):
    """One joint's servo, with the units of `ServoModel`: numbers, or arrays (rows,).

    Args:
        kp: Position loop gain; infinite without a lag.
        kv: Velocity loop gain; infinite without a velocity loop.
        velocity_feedforward: Factor of the command velocity.
        acceleration_feedforward: Factor of the command acceleration.
        dead_time: Delay until a set-point reaches the servo.
        acceleration_limit: Acceleration at which the joint saturates.
        friction: Position error due to dry friction.
        ki: Integral gain of the velocity loop; 0 without an integrator.
    """

    kp: Any
    kv: Any = np.inf
    velocity_feedforward: Any = 0.0
    acceleration_feedforward: Any = 0.0
    dead_time: Any = 0.0
    acceleration_limit: Any = np.inf
    friction: Any = 0.0
    ki: Any = 0.0

    @property
    def lead(self) -> tuple[FloatArray, FloatArray]:
        """Factors by which feed-forward changes the command, as `ServoModel.lead`."""
        feed = self.velocity_feedforward, self.acceleration_feedforward
        return lead_of(self.kp, self.kv, *feed)


class LoggedCommand:
    """Command of one joint in a log, which can be evaluated at any time.

    Args:
        t: Times of all set-points [s], (n,).
        u: Set-points [rad], (n,).
        interpolation: "linear" or "step".
        begin: Index of the set-point at which the motion begins. Earlier set-points may arrive
            during the motion.

    Attributes:
        knots: Times of all set-points [s], (n,).
    """

    def __init__(
        self, t: FloatArray, u: FloatArray, interpolation: str = "linear", begin: int = 0
    ) -> None:
        self.knots = np.array(t)
        self.every = np.array(u)
        self.linear = interpolation == "linear"
        self.t = self.knots[begin:]
        self.u = self.every[begin:]
        self.pieces = command_pieces(self.every[:, None], np.diff(t), interpolation, rest=False)

    def evaluate(self, t: FloatArray) -> FloatArray:
        """Return the command at times t [rad], (n,)."""
        if self.linear:
            return np.interp(t, self.knots, self.every)
        k = np.searchsorted(self.knots, t + SAME_SET_POINT_TIME * 1e-3, side="right") - 1
        return np.asarray(self.every[np.maximum(k, 0)])


class CommandPieces(NamedTuple):
    """Commands of all joints as polynomials in the time since the start of each piece.

    Piece k is between set-points k - 1 and k. Before the first and after the last set-point the
    command is constant.

    Args:
        plain: Coefficients of the command, (dof, n + 1, 4).
        rate: Coefficients of its velocity, (dof, n + 1, 1), for cubics (dof, n + 1, 3).
        bend: Coefficients of its acceleration, shaped like `rate`.
        sliding: Dry-friction factor, (dof, n + 1).
    """

    plain: FloatArray
    rate: FloatArray
    bend: FloatArray
    sliding: FloatArray


def command_pieces(
    q: FloatArray, width: float | FloatArray, interpolation: str, *, rest: bool = True
) -> CommandPieces:
    """Interpolate set-points q [rad], (n, dof), that are `width` apart [s], (n - 1,).

    Args:
        q: Set-points [rad], (n, dof).
        width: Time from each set-point to the next [s], (n - 1,) or one number.
        interpolation: "linear", "step" or "cubic", as in `ServoModel`.
        rest: True if the joints rest at the first set-point before it; otherwise the command before
            it is unknown.
    """
    n, dof = q.shape
    cubic = interpolation == "cubic"
    plain = np.zeros((dof, n + 1, 4))
    rate, bend = np.zeros((2, dof, n + 1, 3 if cubic else 1))
    plain[:, 0, 0] = q[0]
    plain[:, 1:, 0] = q.T
    pieces = CommandPieces(plain, rate, bend, np.zeros((dof, n + 1)))
    if n == 1:
        return pieces
    inner = slice(1, -1)
    chord = np.diff(q, axis=0).T / width
    # Without rest, the command before the first set-point is unknown.
    known = rest or interpolation == "step"
    before = np.concatenate([0.0 * chord[:, :1] if known else chord[:, :1], chord[:, :-1]], axis=1)
    pieces.sliding[:, inner] = sliding(before if interpolation == "step" else chord)
    if interpolation == "step":
        rate[:, inner, 0] = before
    elif interpolation == "linear":
        plain[:, inner, 1] = rate[:, inner, 0] = chord
        bend[:, inner, 0] = (chord - before) / width
    else:
        slope = np.zeros_like(q.T)
        slope[:, 1:-1] = (q[2:] - q[:-2]).T / (2 * width)
        start = slope[:, :-1]
        end = slope[:, 1:]
        plain[:, inner, 1] = start
        plain[:, inner, 2] = (3 * chord - 2 * start - end) / width
        plain[:, inner, 3] = (start + end - 2 * chord) / width**2
        rate[:] = plain[:, :, 1:] * [1, 2, 3]
        bend[:, :, :2] = rate[:, :, 1:] * [1, 2]
    return pieces


def add_feedforward(
    command: CommandPieces, servo: ServoModel | JointServo, first: int = 0
) -> FloatArray:
    """Return the pieces of `command` from `first` on, with feed-forward, (rows, n + 1, 5).

    A `servo` with feed-forward and friction responds to `command` as a servo without them responds
    to these pieces. The last column is the part that bypasses the integrator.
    """
    plain, rate, bend = (x[:, first:] for x in command[:3])
    shape = np.broadcast_shapes(np.shape(servo.lead[0]), np.shape(servo.friction), (len(plain),))
    lead, acceleration, friction = (
        np.broadcast_to(x, shape)[:, None, None] for x in (*servo.lead, servo.friction)
    )
    pieces = np.zeros((*shape, plain.shape[1], 5))
    pieces[:, :, :4] = plain
    if lead.any():
        pieces[:, :, : rate.shape[2]] += lead * rate
    if acceleration.any():
        pieces[:, :, : bend.shape[2]] += acceleration * bend
        pieces[:, :, 4] = acceleration[:, 0] * bend[:, :, 0]
    if friction.any():
        position_error = friction[:, 0] * command.sliding[:, first:]
        pieces[:, :, 0] -= position_error
        pieces[:, :, 4] -= position_error
    return pieces


def sample_command(
    pieces: FloatArray, cycle: float, dead_time: FloatArray, t: FloatArray
) -> FloatArray:
    """Return the delayed command at times t since the first set-point [rad], (n, dof).

    Args:
        pieces: Command of each joint, from `add_feedforward`, (dof, pieces, 5).
        cycle: Time between two set-points [s].
        dead_time: Delay of each joint [s], (dof,).
        t: Times since the first set-point [s], (n,).
    """
    commands = np.zeros((len(t), len(pieces)))
    for j, joint_pieces in enumerate(pieces):
        phase = (t - dead_time[j]) / cycle
        k = np.clip(np.floor(phase + SAME_SET_POINT_TIME), -1, len(joint_pieces) - 2).astype(
            np.intp
        )
        # The command is constant in the first and in the last interval.
        elapsed = np.where(
            (k < 0) | (k > len(joint_pieces) - 3), 0.0, np.maximum(phase - k, 0.0) * cycle
        )
        degrees = reversed(joint_pieces[:, :4].T)
        for coefficients in degrees:
            commands[:, j] = coefficients[k + 1] + elapsed * commands[:, j]
    return commands


def command_weights(
    count: int, cycle: float, interpolation: str, t: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return indices and weights of the set-points that the command depends on, (n, 2 or 4).

    Args:
        count: Number of set-points.
        cycle: Time between two set-points [s].
        interpolation: "linear", "step" or "cubic".
        t: Times since the first set-point [s], (n,).
    """
    phase = np.clip(t / cycle, 0.0, count - 1)
    k = np.minimum(np.floor(phase + SAME_SET_POINT_TIME), max(count - 2, 0)).astype(np.intp)
    fraction = np.clip(phase - k, 0.0, 1.0)
    if interpolation != "cubic":
        # The last set-point is reached at the end of the last interval.
        end = (
            fraction
            if interpolation == "linear"
            else (fraction >= 1 - SAME_SET_POINT_TIME).astype(np.float64)
        )
        return np.minimum(k[:, None] + [0, 1], count - 1), np.column_stack([1 - end, end])
    index = np.clip(k[:, None] + np.arange(-1, 3), 0, count - 1)
    weight = np.zeros((len(t), 4))
    end = fraction * fraction * (3 - 2 * fraction)
    weight[:, 1] = 1 - end
    weight[:, 2] = end
    # The slopes at the first and the last set-point are 0.
    slope = np.where(k > 0, fraction * (1 - fraction) ** 2, 0.0) / 2
    weight[:, 0] -= slope
    weight[:, 2] += slope
    slope = np.where(k < count - 2, -fraction * fraction * (1 - fraction), 0.0) / 2
    weight[:, 1] -= slope
    weight[:, 3] += slope
    return index, weight
