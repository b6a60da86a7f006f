"""Limits as rows of the quadratic program, linear in changes of control points and span times.

The joint path is a quadratic B-spline in time with control points q_i and span times h_i. The joint
velocity at the knot between spans i and i + 1 is `e_i = 2 (q_{i+1} - q_i) / (h_i + h_{i+1})`, and
the joint acceleration in span i is `(e_i - e_{i-1}) / h_i`. A limit of span i is a function of
e_{i-1}, e_i and h_i that must be at most zero; its row has the derivatives of that function.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.frames import perpendicular
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import States

# Number of directions in a plane in which the acceleration is bounded.
DIRECTIONS = 8
# (speed - limit) / limit below which a speed is ignored, because one step cannot reach the limit
FAR_BELOW_LIMIT = -0.6
# Finite bound for joints without a limit, which is never active [SI].
NEVER = 1e6
# Largest relative decrease of a span time in one step.
LEAST_SPAN = 0.5


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Control point next to a part of a longer spline."""

    q: FloatArray  # Joint positions [rad], (dof,)
    h: float  # Time of its span [s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointSpline:
    """Quadratic B-spline in time with n control points, or a part of a longer spline.

    A spline that is not a part is at rest at both ends.
    """

    q: FloatArray  # Control points [rad], (n, dof)
    h: FloatArray  # Span times [s], (n,)
    # True if the joints rest at a knot before, between or after the spans, (n + 1,). Both control
    # points next to a rest between spans are at the rest.
    rest: BoolArray
    before: Neighbour | None = None  # Control point before those of a part; None at the start
    after: Neighbour | None = None  # Control point after those of a part; None at the end

    @property
    def velocities(self) -> FloatArray:
        """Joint velocities at the knots before, between and after the spans, (n + 1, dof)."""
        e = np.zeros((len(self.q) + 1, self.q.shape[1]))
        e[1:-1] = 2 * np.diff(self.q, axis=0) / (self.h[1:] + self.h[:-1])[:, None]
        if self.before is not None:
            e[0] = 2 * (self.q[0] - self.before.q) / (self.h[0] + self.before.h)
        if self.after is not None:
            e[-1] = 2 * (self.after.q - self.q[-1]) / (self.h[-1] + self.after.h)
        e[self.rest] = 0.0
        return e

    @property
    def knots(self) -> FloatArray:
        """Joint positions at the knots before, between and after the spans, (n + 1, dof)."""
        before = None if self.before is None else self.before.q
        after = None if self.after is None else self.after.q
        return self.at_knots(self.q, before, after)

    def at_knots(
        self, values: FloatArray, before: FloatArray | None = None, after: FloatArray | None = None
    ) -> FloatArray:
        """Interpolate values at the control points, (n, k), to values at the knots, (n + 1, k).

        - `before`, `after`: values at the control points next to a part of a spline, (k,).
        """
        h = self.h[:, None]
        out = np.empty((len(values) + 1, values.shape[1]))
        out[1:-1] = (h[1:] * values[:-1] + h[:-1] * values[1:]) / (h[1:] + h[:-1])
        out[0] = values[0]
        out[-1] = values[-1]
        if self.before is not None and before is not None:
            out[0] = (h[0] * before + self.before.h * values[0]) / (h[0] + self.before.h)
        if self.after is not None and after is not None:
            out[-1] = (self.after.h * values[-1] + h[-1] * after) / (h[-1] + self.after.h)
        return out


@dataclass(slots=True)
class SpanRows:
    """Limits of all spans, as functions of span time and velocities at both ends."""

    value: FloatArray  # Values of the functions, at most zero if a limit is satisfied, (n, m)
    before: FloatArray  # Derivatives with respect to the velocity at the start, (n, m, dof)
    after: FloatArray  # Derivatives with respect to the velocity at the end, (n, m, dof)
    time: FloatArray  # Derivatives with respect to the span time, (n, m)
    scale: FloatArray  # Divisors of the values, proportional to the limits, (n, m)


def span_rows(spline: JointSpline, arm: Arm, limits: Limits, speeds: FloatArray) -> SpanRows:
    """Return the rows of all limits, except angular limits of the tool and joint ranges.

    Rotation depends on the orientation, which is a function of the objective and not of the
    offsets; the exact timing satisfies its limits. Shapes that leave a joint range cannot be
    traced.

    - `limits`: the limits, one value per joint.
    - `speeds`: assigned velocity at the end of every span [m/s], infinite if none, (n,).
    """
    e = spline.velocities
    knots = spline.knots
    h = spline.h
    a = np.diff(e, axis=0) / h[:, None]
    n, dof = spline.q.shape
    none = np.zeros((n, 0))
    groups = [SpanRows(none, np.zeros((n, 0, dof)), np.zeros((n, 0, dof)), none, none)]
    eye = np.eye(dof)
    signed_axes = np.broadcast_to(np.concatenate([eye, -eye]), (n, 2 * dof, dof))
    if limits.joint_acceleration is not None:
        lower, upper = limits.acceleration_bounds(dof)
        groups.append(_acceleration_rows(signed_axes, e, h, np.concatenate([upper, -lower])))
    if limits.joint_velocity is not None:
        lower, upper = limits.velocity_bounds(dof)
        groups.append(_velocity_rows(signed_axes, e, np.concatenate([upper, -lower])))
    ends = [States(arm, (knots[:-1], e[:-1], a)), States(arm, (knots[1:], e[1:], a))]
    if np.isfinite(speeds).any():
        groups.append(_tool_speed_rows(ends[1], speeds))
    for last, states in enumerate(ends):
        if limits.centripetal_acceleration is not None:
            groups.append(
                _tool_acceleration_rows(
                    states, h, limits.centripetal_acceleration, bool(last), across=True
                )
            )
        if limits.tool_acceleration is not None:
            groups.append(
                _tool_acceleration_rows(
                    states, h, limits.tool_acceleration, bool(last), across=False
                )
            )
        if limits.joint_torque is not None:
            groups.append(
                _torque_rows(states, signed_axes, h, np.asarray(limits.joint_torque), bool(last))
            )
    return _join_groups(groups)


def _join_groups(groups: Sequence[SpanRows]) -> SpanRows:
    """Join groups of rows that belong to the same spans."""
    return SpanRows(
        value=np.concatenate([x.value for x in groups], axis=1),
        before=np.concatenate([x.before for x in groups], axis=1),
        after=np.concatenate([x.after for x in groups], axis=1),
        time=np.concatenate([x.time for x in groups], axis=1),
        scale=np.concatenate([x.scale for x in groups], axis=1),
    )


def _acceleration_rows(
    signed_axes: FloatArray, e: FloatArray, h: FloatArray, limit: FloatArray
) -> SpanRows:
    """Return the rows `±(e_i - e_{i-1}) <= limit h_i`, those of positive accelerations first."""
    bound = np.broadcast_to(np.minimum(limit, NEVER), signed_axes.shape[:2])
    value = np.einsum("nrj,nj->nr", signed_axes, np.diff(e, axis=0)) - bound * h[:, None]
    return SpanRows(value, -signed_axes, signed_axes, -bound, bound * h[:, None])


def _velocity_rows(signed_axes: FloatArray, e: FloatArray, limit: FloatArray) -> SpanRows:
    """Return the rows `±e_i <= limit` of the joint velocities."""
    bound = np.broadcast_to(np.minimum(limit, NEVER), signed_axes.shape[:2])
    value = np.einsum("nrj,nj->nr", signed_axes, e[1:]) - bound
    after = np.where((value > FAR_BELOW_LIMIT * bound)[..., None], signed_axes, 0.0)
    return SpanRows(value, np.zeros_like(signed_axes), after, np.zeros_like(value), bound)


def _tool_speed_rows(end: States, speeds: FloatArray) -> SpanRows:
    """Return the rows `|J e_i| <= speed` of the tool speed."""
    velocity = end.tool_velocity
    speed = np.linalg.norm(velocity, axis=1)
    direction = velocity / np.where(speed > 0, speed, 1.0)[:, None]
    # A span without a limit has a bound that is never active.
    bound = np.where(np.isfinite(speeds), speeds, 10 * speed + 1)
    near = np.where(speed - bound > FAR_BELOW_LIMIT * bound, 1.0, 0.0)[:, None] * direction
    after = np.einsum("ni,nij->nj", near, end.arm.tool_jacobian(end.q))[:, None]
    none = np.zeros((len(speed), 1))
    return SpanRows((speed - bound)[:, None], np.zeros_like(after), after, none, bound[:, None])


def _tool_acceleration_rows(
    end: States, h: FloatArray, limit: float, last: bool, *, across: bool
) -> SpanRows:
    """Return the rows of the tool acceleration in several directions, or of its normal part.

    - `end`: joint states at one end of the spans.
    - `h`: span times [s], (n,).
    - `last`: true if that end is the end of the spans.
    - `across`: true for the part normal to the motion, the centripetal acceleration.
    """
    # The acceleration in direction d is `d (J a + H(e, e))`, with H(e, e) = dJ/dt e. All rows are
    # multiplied by h_i.
    arm = end.arm
    q = end.q
    e = end.dq
    jacobian = arm.tool_jacobian(q)
    rate = arm.tool_jacobian_rate(q, e)
    velocity = np.einsum("nij,nj->ni", jacobian, e)
    acceleration = np.einsum("nij,nj->ni", jacobian, end.ddq) + np.einsum("nij,nj->ni", rate, e)
    speed = np.linalg.norm(velocity, axis=1)
    moving = speed > 0
    tangent = velocity / np.where(moving, speed, 1.0)[:, None]
    along = np.sum(tangent * acceleration, axis=1)
    d = _directions(tangent, acceleration, across=across)
    value = (np.einsum("nri,ni->nr", d, acceleration) - limit) * h[:, None]
    by_change = np.einsum("nri,nij->nrj", d, jacobian)
    # H is quadratic in e. Directions normal to the motion rotate with the velocity.
    by_end = 2 * np.einsum("nri,nij->nrj", d, rate)
    if across:
        turn = np.where(moving, along / np.where(moving, speed, 1.0), 0.0)
        by_end = by_end - turn[:, None, None] * by_change
    by_end = by_end * h[:, None, None]
    before, after = _derivatives_at_ends(by_change, by_end, last)
    time = np.einsum("nri,nij,nj->nr", d, rate, e) - limit
    if across:
        # At rest there is no component normal to the motion.
        for array in (before, after, time, value):
            array[~moving] = 0.0
    return SpanRows(value, before, after, time, np.full_like(value, limit) * h[:, None])


def _directions(tangent: FloatArray, acceleration: FloatArray, *, across: bool) -> FloatArray:
    """Return unit vectors in which the acceleration is bounded, (n, m, dimension)."""
    # The first direction is parallel to the acceleration, or to its part normal to the motion.
    n, dimension = tangent.shape
    if dimension == 2:
        first = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        other = tangent
        if across:
            return np.stack([first, -first], axis=1)
    else:
        part = acceleration
        if across:
            part = part - np.sum(part * tangent, axis=1, keepdims=True) * tangent
        size = np.linalg.norm(part, axis=1, keepdims=True)
        spare = perpendicular(tangent)
        first = np.where(size > 1e-9, part / np.where(size > 1e-9, size, 1.0), spare)
        first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
        third = tangent if across else spare
        other = np.cross(third, first)
        length = np.linalg.norm(other, axis=1, keepdims=True)
        other = other / np.where(length > 1e-9, length, 1.0)
    if not across and dimension == 2:
        size = np.linalg.norm(acceleration, axis=1, keepdims=True)
        first = np.where(size > 1e-9, acceleration / np.where(size > 1e-9, size, 1.0), first)
        other = np.stack([-first[:, 1], first[:, 0]], axis=1)
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    directions = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * other[:, None]
    if not across and dimension == 3:
        third = np.cross(first, other)[:, None]
        directions = np.concatenate([directions, third, -third], axis=1)
    return np.asarray(directions)


def _torque_rows(
    end: States, signed_axes: FloatArray, h: FloatArray, limit: FloatArray, last: bool
) -> SpanRows:
    """Return the rows of the torques at one end of the spans.

    They are `±(M (e_i - e_{i-1}) + h_i (c + g + f)) <= limit h_i`.
    """
    # Coriolis torques c grow with the square of the velocity; mass matrix M, gravity g and friction
    # f are treated as constant.
    dynamics = end.arm.dynamics
    zero = np.zeros_like(end.dq)
    mass = dynamics.mass_matrix(end.q)
    gravity = dynamics.torque(end.q, zero, zero)
    friction = dynamics.friction(end.dq)
    bias = dynamics.torque(end.q, end.dq, zero) + friction
    bound = np.broadcast_to(np.tile(np.minimum(limit, NEVER), 2), signed_axes.shape[:2])
    torque = np.einsum("nij,nj->ni", mass, end.ddq) + bias
    value = (np.einsum("nrj,nj->nr", signed_axes, torque) - bound) * h[:, None]
    by_change = np.einsum("nri,nij->nrj", signed_axes, mass)
    # The derivative of a function that grows with |e|², here h c, is 2 h c e / |e|².
    square = np.sum(end.dq**2, axis=1)
    factor = 2 * h / np.where(square > 0, square, 1.0)
    coriolis = np.einsum("nrj,nj->nr", signed_axes, bias - gravity - friction)
    by_end = (factor[:, None] * coriolis)[..., None] * end.dq[:, None]
    before, after = _derivatives_at_ends(by_change, by_end, last)
    time = np.einsum("nrj,nj->nr", signed_axes, bias) - bound
    return SpanRows(value, before, after, time, bound * h[:, None])


def _derivatives_at_ends(
    by_change: FloatArray, by_end: FloatArray, last: bool
) -> tuple[FloatArray, FloatArray]:
    """Convert derivatives by velocity change and one velocity to derivatives by both velocities."""
    return (-by_change, by_change + by_end) if last else (by_end - by_change, by_change)


def assemble(
    spline: JointSpline, rows: SpanRows, steps: FloatArray, unit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the rows of the quadratic program in scaled unknowns, and their bounds.

    The unknowns of node i are its offsets divided by `unit`, and the relative change of h_i.

    Returns coefficients, (n, m, 3 (k + 1)), and bounds, (n, m).

    - `steps`: derivatives of each control point with respect to its offsets [rad/m], (n, dof, k).
    - `unit`: scale of the offsets of each node, 0 if fixed [m], (n,).
    """
    # The velocities at both ends of the spline do not change: they are zero at rests, and the
    # control points next to the ends of a part are fixed.
    n, dof, k = steps.shape
    e = spline.velocities
    h = spline.h
    pair = np.full(n + 1, np.inf)
    pair[1:-1] = h[1:] + h[:-1]
    rate = np.where(spline.rest, 0.0, 2 / pair)
    scaled = steps * unit[:, None, None]
    width = k + 1
    coefficients = np.zeros((n, rows.value.shape[1], 3 * width))
    for derivatives, first in ((rows.before, 0), (rows.after, 1)):
        # The velocity at this end depends on the nodes `first - 1` and `first`, counted from the
        # node of the row.
        pace = rate[first : n + first]
        ends = e[first : n + first]
        for node, sign in ((first - 1, -1.0), (first, 1.0)):
            column = (node + 1) * width
            near = np.clip(np.arange(n) + node, 0, n - 1)
            part = np.einsum("nrj,njk->nrk", derivatives, scaled[near])
            coefficients[:, :, column : column + k] += sign * pace[:, None, None] * part
            slower = -np.einsum("nrj,nj->nr", derivatives, ends) * (pace / 2)[:, None]
            coefficients[:, :, column + k] += slower * h[near][:, None]
    coefficients[:, :, width + k] += rows.time * h[:, None]
    scale = 1 / rows.scale
    return coefficients * scale[..., None], -rows.value * scale
