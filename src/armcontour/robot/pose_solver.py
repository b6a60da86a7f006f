"""Compiled inverse kinematics: Newton's method, damped least squares, pose sequences.

The task dimension is the number of equations per target pose: 6; 5 if rotation about the tool axis
is free; 4 for the tool point and the rotation about the direction of all revolute joints, if they
are parallel; 3 for the tool point only. If the arm has more joints than equations, guide equations
`w q = w g` fix the redundant degrees of freedom: w are the rows of the guide, g its joint
positions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled
from armcontour.robot.kernels import FACTOR, LEADER, SLIDES, Vector, add, cross, write_frames

# In all tolerances of joints, a metre of a prismatic joint counts as a radian, because levers of
# arms are about 1 m long.
# Newton's method ends when its step is below this [rad or m], because the next step would be about
# the square of this step times the condition number of the Jacobian.
CONVERGED_STEP = 1e-10
# Largest number of steps of Newton's method.
MAX_NEWTON_ITERATIONS = 15
# Longest step of a joint [rad]; longer steps are reduced.
LONGEST_JOINT_STEP = 0.5
# `follow`: longest correction of any joint [rad].
FOLLOW_STEP = 0.15
# `follow`: largest number of corrections per step.
FOLLOW_CORRECTIONS = 6
# `follow` gives up after it has halved the step between two poses this many times.
MAX_FOLLOW_HALVINGS = 12
# `approach`: first, smallest and largest damping of the least-squares steps.
FIRST_DAMPING = 0.05
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e3
# `approach`: factors of the damping after a step that reduces the error, and after another one.
LESS_DAMPING = 0.3
MORE_DAMPING = 4.0
# `approach` ends at a squared error below this [m²], or after a step that reduces the squared error
# by less than this fraction.
NO_ERROR = 1e-26
NO_GAIN = 1e-12
# Smallest sine of the rotation between two poses that determines its axis.
SMALLEST_SINE = 1e-12
# A matrix counts as singular if the ratio of its smallest to its largest pivot is below this.
SINGULAR_PIVOTS = 1e-11


@compiled(inner=True)
def solve(a: FloatArray, b: FloatArray, n: int) -> float:
    """Solve a x = b in place by Gaussian elimination with pivoting.

    Returns the ratio of the smallest to the largest pivot; 0 if a is singular.

    - `a`: (n, n).
    - `b`: (n,).
    """
    smallest = math.inf
    largest = 0.0
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(a[k, i]) > abs(a[best, i]):
                best = k
        if best != i:
            for j in range(n):
                a[i, j], a[best, j] = a[best, j], a[i, j]
            b[i], b[best] = b[best], b[i]
        pivot = a[i, i]
        smallest = min(smallest, abs(pivot))
        largest = max(largest, abs(pivot))
        if pivot == 0.0 or not math.isfinite(pivot):
            return 0.0
        for k in range(i + 1, n):
            factor = a[k, i] / pivot
            if factor != 0.0:
                for j in range(i + 1, n):
                    a[k, j] -= factor * a[i, j]
                b[k] -= factor * b[i]
    for i in range(n - 1, -1, -1):
        value = b[i]
        for k in range(i + 1, n):
            value -= a[i, k] * b[k]
        b[i] = value / a[i, i]
    return smallest / largest


@compiled(inner=True)
def write_row(row: FloatArray, out: FloatArray) -> None:
    """Copy a row into another array, number by number; array assignments take long to compile."""
    for k in range(len(row)):
        out[k] = row[k]


@compiled(inner=True)
def column(frame: FloatArray, k: int) -> Vector:
    """Return column k of a frame: an axis, k = 0 to 2, or the origin, k = 3."""
    return frame[0, k], frame[1, k], frame[2, k]


@compiled(inner=True)
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(inner=True)
def first_revolute(links: FloatArray) -> int:
    """Return the index of the first joint that turns; 0 if all slide."""
    for k in range(len(links) - 1):
        if links[k, SLIDES] == 0.0:
            return k
    return 0


@compiled(inner=True)
def write_task(
    links: FloatArray,
    task: int,
    frames: FloatArray,
    target: FloatArray,
    move: Vector,
    turn: Vector,
    out: FloatArray,
) -> None:
    """Write the components of a tool motion that the task prescribes into `out`, (task,).

    - `frames`: frames of the joints, of which task 4 uses the axis of the first revolute joint.
    - `move`: motion of the tool point.
    - `turn`: rotation of the tool.
    """
    out[0], out[1], out[2] = move
    if task == 6:
        out[3], out[4], out[5] = turn
    elif task == 5:
        out[3] = dot(column(target, 0), turn)
        out[4] = dot(column(target, 1), turn)
    elif task == 4:
        out[3] = dot(column(frames[first_revolute(links)], 2), turn)


class PoseEquations(NamedTuple):
    """Work arrays for the equations of one pose."""

    frames: FloatArray  # Frames of the joints and of the tool, (rows, 3, 4)
    rows: FloatArray  # Derivative of the tool pose by q, (task, dof) or more rows
    error: FloatArray  # Pose error, (task,) or longer


@compiled(inner=True)
def write_equations(
    links: FloatArray, task: int, q: FloatArray, target: FloatArray, out: PoseEquations
) -> None:
    """Write the tool's pose error, and the derivative of its pose by the joint positions.

    The first 3 values are the position error [m]. For task 6 the others are the rotation vector
    from the pose to the target [rad]. For task 5 they are the components of the rotation vector
    between the tool axes along the target's x and y axes [rad]. For task 4 the other is the
    component of the rotation vector along the axis of the first revolute joint [rad].

    - `links`: (rows, 15).
    - `q`: joint positions [rad or m], (dof,).
    - `target`: (3, 4).
    """
    last = len(links) - 1
    rows = out.rows
    frames = out.frames
    write_frames(links, q, frames)
    pose = frames[last]
    for r in range(task):
        for k in range(len(q)):
            rows[r, k] = 0.0
    for j in range(last):
        axis = column(frames[j], 2)
        lever = add(column(pose, 3), -1.0, column(frames[j], 3))
        move = cross(axis, lever)
        if links[j, SLIDES] != 0.0:
            move = axis
            axis = (0.0, 0.0, 0.0)
        # Joints that follow another one add their motion to its column.
        k = int(links[j, LEADER])
        factor = links[j, FACTOR]
        for r in range(3):
            rows[r, k] += factor * move[r]
        if task == 6:
            for r in range(3):
                rows[3 + r, k] += factor * axis[r]
        elif task == 5:
            rows[3, k] += factor * dot(column(target, 0), axis)
            rows[4, k] += factor * dot(column(target, 1), axis)
        elif task == 4:
            rows[3, k] += factor * dot(column(frames[first_revolute(links)], 2), axis)
    turn = (0.0, 0.0, 0.0)
    cosine = 0.0
    whole = task == 6 or task == 4
    # Sum up the sine (times the axis) and cosine of the rotation to the target, doubled for whole
    # rotations.
    for k in range(0 if whole else 2, 3):
        turn = add(turn, 1.0, cross(column(pose, k), column(target, k)))
        cosine += dot(column(pose, k), column(target, k))
    cosine -= 1.0 if whole else 0.0
    sine = math.sqrt(dot(turn, turn))
    scale = 0.5 if whole else 1.0
    if sine > SMALLEST_SINE:
        scale = math.atan2(sine, cosine) / sine
    elif cosine < 0.0:
        # At half a turn the axis is undefined; a rotation about any axis makes progress.
        turn = (1.0, 0.0, 0.0) if task == 6 else column(target, 0)
        if task == 4:
            turn = column(frames[first_revolute(links)], 2)
        scale = math.pi
    move = add(column(target, 3), -1.0, column(pose, 3))
    turn = add((0.0, 0.0, 0.0), scale, turn)
    write_task(links, task, frames, target, move, turn, out.error)


@compiled()
def solve_poses(
    links: FloatArray, task: int, q: FloatArray, targets: FloatArray, w: FloatArray, g: FloatArray
) -> BoolArray:
    """Solve the inverse kinematics by Newton's method; return the mask of solved poses, (n,).

    A step solves `J dq = e`, with the pose error e and the derivative J of the tool pose by q, and
    the guide equations `w (q + dq) = w g`. The guide equations use only w[:, 0] and g[:, 0];
    derivatives in w[:, 1:] and g[:, 1:] are ignored.

    - `links`: (rows, 15).
    - `task`: task dimension.
    - `q`: initial guesses [rad], (n, dof); overwritten.
    - `targets`: target poses, (n, 3, 4).
    - `w`, `g`: guide rows, (n, orders, dof - task, dof), and its joint positions, (n, orders, dof).
    """
    n, dof = q.shape
    converged = np.empty(n, np.bool_)
    a = np.empty((dof, dof))
    b = np.empty(dof)
    equations = PoseEquations(np.empty((len(links), 3, 4)), a, b)
    for i in range(n):
        converged[i] = False
        for _ in range(MAX_NEWTON_ITERATIONS):
            write_equations(links, task, q[i], targets[i], equations)
            for r in range(task, dof):
                write_row(w[i, 0, r - task], a[r])
                b[r] = 0.0
                for k in range(dof):
                    b[r] += a[r, k] * (g[i, 0, k] - q[i, k])
            if solve(a, b, dof) < SINGULAR_PIVOTS:
                break
            size = 0.0
            for k in range(dof):
                size = max(size, abs(b[k]))
            scale = LONGEST_JOINT_STEP / size if size > LONGEST_JOINT_STEP else 1.0
            for k in range(dof):
                q[i, k] += scale * b[k]
            if size < CONVERGED_STEP:
                converged[i] = True
                break
    return converged


class PathRates(NamedTuple):
    """Motion of a target pose along the path, per arc length."""

    move: Vector  # First derivative of the position
    acceleration: Vector  # Second derivative of the position [1/m]
    turn: Vector  # Angular velocity [rad/m]
    twist: Vector  # Its derivative [rad/m²]


class PathDerivatives(NamedTuple):
    """Derivatives of joint positions at the poses of a path."""

    dq_ds: FloatArray  # [rad/m], (n, dof)
    d2q_ds2: FloatArray  # [rad/m²], (n, dof)
    # Ratio of the smallest to the largest pivot of the equations, (n,); 0 if singular
    pivot_ratio: FloatArray


@compiled()
def path_derivatives(
    links: FloatArray,
    task: int,
    q: FloatArray,
    targets: FloatArray,
    rates: FloatArray,
    w: FloatArray,
    g: FloatArray,
) -> PathDerivatives:
    """Return the first and second derivatives of joint positions by the arc length.

    The equations of a pose and of the guide are differentiated once and twice. With the derivative
    J of the tool pose by q, the tool's velocity is `J dq`, and its acceleration `J ddq + r`, where
    r is the acceleration for `ddq = 0`. If rotation about the tool axis is free, the equations of
    the orientation are `x . omega = x . turn` for the target's x and y axes, which rotate with the
    target.

    - `links`: (rows, 15).
    - `q`: joint positions at the poses [rad], (n, dof).
    - `targets`: (n, 3, 4).
    - `rates`: `PathRates` of the targets, (n, 4, 3).
    - `w`: guide and its first two derivatives, (n, 3, dof - task, dof).
    - `g`: joint positions of the guide and their first two derivatives, (n, 3, dof).
    """
    n, dof = q.shape
    dq_ds = np.empty((n, dof))
    d2q_ds2 = np.empty((n, dof))
    pivot_ratio = np.empty(n)
    frames = np.empty((len(links), 3, 4))
    a = np.empty((dof, dof))
    b = np.empty(dof)
    copy = np.empty((dof, dof))
    for i in range(n):
        # Matrix of the equations, whose rows are those of the pose and of the guide
        write_equations(links, task, q[i], targets[i], PoseEquations(frames, a, b))
        rate = PathRates(
            row_of(rates, i, 0), row_of(rates, i, 1), row_of(rates, i, 2), row_of(rates, i, 3)
        )
        for r in range(task, dof):
            write_row(w[i, 0, r - task], a[r])
        # First derivative: w dq = w dg - dw (q - g)
        write_task(links, task, frames, targets[i], rate.move, rate.turn, b)
        for r in range(task, dof):
            b[r] = 0.0
            for k in range(dof):
                b[r] += a[r, k] * g[i, 1, k] - w[i, 1, r - task, k] * (q[i, k] - g[i, 0, k])
        for k in range(dof):
            write_row(a[k], copy[k])
        pivot_ratio[i] = solve(copy, b, dof)
        write_row(b, dq_ds[i])
        # Second derivative: w ddq = w ddg - 2 dw (dq - dg) - ddw (q - g)
        write_second_task(links, task, frames, targets[i], rate, b)
        for r in range(task, dof):
            w0 = w[i, 0, r - task]
            w1 = w[i, 1, r - task]
            w2 = w[i, 2, r - task]
            b[r] = 0.0
            for k in range(dof):
                b[r] += w0[k] * g[i, 2, k] - 2.0 * w1[k] * (dq_ds[i, k] - g[i, 1, k])
                b[r] -= w2[k] * (q[i, k] - g[i, 0, k])
        solve(a, b, dof)
        write_row(b, d2q_ds2[i])
    return PathDerivatives(dq_ds, d2q_ds2, pivot_ratio)


@compiled(inner=True)
def row_of(rates: FloatArray, i: int, k: int) -> Vector:
    """Return vector k of pose i, in the order of `PathRates`."""
    return rates[i, k, 0], rates[i, k, 1], rates[i, k, 2]


@compiled(inner=True)
def write_second_task(
    links: FloatArray,
    task: int,
    frames: FloatArray,
    target: FloatArray,
    path_rates: PathRates,
    b: FloatArray,
) -> None:
    """Replace dq, (dof,), by the target's acceleration less the tool's for `ddq = 0`, (task,)."""
    # Angular velocity of the tool, and its acceleration and angular acceleration for ddq = 0,
    # from joint to joint
    turned = tool_acceleration = twisted = (0.0, 0.0, 0.0)
    for k in range(len(links) - 1):
        # The rotation of the previous link turns the joint axis, which adds omega x axis dq.
        axis = column(frames[k], 2)
        rate = links[k, FACTOR] * b[int(links[k, LEADER])]
        if links[k, SLIDES] != 0.0:
            # The Coriolis acceleration is 2 omega x axis dq; it does not turn later links.
            tool_acceleration = add(tool_acceleration, 2.0 * rate, cross(turned, axis))
        else:
            twisted = add(twisted, rate, cross(turned, axis))
            turned = add(turned, rate, axis)
        lever = add(column(frames[k + 1], 3), -1.0, column(frames[k], 3))
        tool_acceleration = add(tool_acceleration, 1.0, cross(twisted, lever))
        tool_acceleration = add(tool_acceleration, 1.0, cross(turned, cross(turned, lever)))
    # The tool may rotate about its axis at another rate than the target, so the difference of the
    # angular velocities is along the tool axis.
    free = cross(add(path_rates.turn, -1.0, turned), path_rates.turn)
    twist = add(add(path_rates.twist, -1.0, twisted), 1.0, free)
    acceleration = add(path_rates.acceleration, -1.0, tool_acceleration)
    write_task(links, task, frames, target, acceleration, twist, b)


@compiled()
def free_motions(links: FloatArray, task: int, q: FloatArray, targets: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the self-motion at a fixed tool pose, (n, dof - task, dof).

    For task 5 the tool may rotate about its axis, for task 3 about the tool point. Joints of an arm
    with task 4 cannot rotate the tool about other directions. The basis is made by Gram-Schmidt
    orthogonalization.

    - `links`: (rows, 15).
    - `q`: joint positions [rad], (n, dof).
    - `targets`: (n, 3, 4).
    """
    n, dof = q.shape
    basis = np.empty((n, dof - task, dof))
    rows = np.empty((dof, dof))
    residual = np.empty(dof)
    equations = PoseEquations(np.empty((len(links), 3, 4)), rows, np.empty(dof))
    for i in range(n):
        write_equations(links, task, q[i], targets[i], equations)
        for r in range(dof):
            if r >= task:
                # Start from the unit vector (of one joint) farthest from the span of the previous
                # rows.
                farthest = 0
                for k in range(dof):
                    residual[k] = 1.0
                    rows[r, k] = 0.0
                    for j in range(r):
                        residual[k] -= rows[j, k] ** 2
                    if residual[k] > residual[farthest]:
                        farthest = k
                rows[r, farthest] = 1.0
            # Two passes of Gram-Schmidt make the rows orthogonal to the last digit.
            for _ in range(2):
                for j in range(r):
                    along = 0.0
                    for k in range(dof):
                        along += rows[j, k] * rows[r, k]
                    for k in range(dof):
                        rows[r, k] -= along * rows[j, k]
                size = 0.0
                for k in range(dof):
                    size += rows[r, k] ** 2
                if size > 0.0:
                    for k in range(dof):
                        rows[r, k] /= math.sqrt(size)
        for r in range(task, dof):
            write_row(rows[r], basis[i, r - task])
    return basis


@compiled(inner=True)
def write_shortest_step(
    task: int,
    equations: PoseEquations,
    damping: float,
    square: FloatArray,
    right: FloatArray,
    out: FloatArray,
) -> float:
    """Write the shortest joint step that removes the pose error; return its size [rad].

    The step is `J^T (J J^T + damping² I)^-1 e`; it is long or not finite near a singularity.

    - `square`, `right`: work arrays, (6, 6) and (6,).
    - `out`: the step [rad], (dof,).
    """
    rows = equations.rows
    dof = len(out)
    for i in range(task):
        for j in range(i + 1):
            value = damping * damping if i == j else 0.0
            for k in range(dof):
                value += rows[i, k] * rows[j, k]
            square[i, j] = square[j, i] = value
        right[i] = equations.error[i]
    if solve(square, right, task) == 0.0:
        return math.inf
    largest = 0.0
    for k in range(dof):
        value = 0.0
        for i in range(task):
            value += rows[i, k] * right[i]
        out[k] = value
        largest = max(largest, abs(value))
    return largest


@compiled()
def approach(
    links: FloatArray, task: int, target: FloatArray, q: FloatArray, weight: float, max_steps: int
) -> FloatArray:
    """Move q [rad] to a pose by damped least squares; return remaining errors [m, rad], (n, 2).

    Steps are those of `write_shortest_step` (Wampler, IEEE Trans. Syst. Man Cybern. 16, 93-101,
    1986). The damping decreases after a step that reduces the error, and increases otherwise.

    - `links`: (rows, 15).
    - `target`: (3, 4).
    - `q`: initial positions, (n, dof); overwritten.
    - `weight`: weight of a radian relative to a metre [m/rad].
    """
    n, dof = q.shape
    frames = np.empty((len(links), 3, 4))
    square = np.empty((6, 6))
    right = np.empty(6)
    best = PoseEquations(frames, np.empty((6, dof)), np.empty(6))
    tried = PoseEquations(frames, np.empty((6, dof)), np.empty(6))
    step = np.empty(dof)
    trial = np.empty(dof)
    residual = np.empty((n, 2))
    for i in range(n):
        damping = FIRST_DAMPING
        cost = math.inf
        residual[i, 0] = math.inf
        residual[i, 1] = math.inf
        write_row(q[i], trial)
        for _ in range(max_steps):
            # Error and derivative of the trial, with weighted rotations
            write_equations(links, task, trial, target, tried)
            error = tried.error
            turn = 0.0
            for r in range(3, task):
                error[r] *= weight
                turn += error[r] ** 2
                for k in range(dof):
                    tried.rows[r, k] *= weight
            # Accept the trial if its error is smaller.
            position_cost = error[0] ** 2 + error[1] ** 2 + error[2] ** 2
            if position_cost + turn < cost:
                gain = cost - (position_cost + turn)
                cost = position_cost + turn
                best, tried = tried, best
                write_row(trial, q[i])
                residual[i, 0] = math.sqrt(position_cost)
                residual[i, 1] = math.sqrt(turn) / weight
                damping = max(damping * LESS_DAMPING, LEAST_DAMPING)
                if cost < NO_ERROR or gain < NO_GAIN * cost:
                    break
            else:
                damping *= MORE_DAMPING
                if damping > MOST_DAMPING:
                    break
            # Next trial from the best positions
            size = write_shortest_step(task, best, damping, square, right, step)
            if not math.isfinite(size):
                break
            scale = LONGEST_JOINT_STEP / size if size > LONGEST_JOINT_STEP else 1.0
            for k in range(dof):
                trial[k] = q[i, k] + scale * step[k]
    return residual


@compiled(inner=True)
def write_pose_between(
    first: FloatArray, second: FloatArray, fraction: float, out: FloatArray
) -> None:
    """Write the pose at `fraction` (0 to 1) between two close poses."""
    for i in range(3):
        for j in range(4):
            out[i, j] = first[i, j] + fraction * (second[i, j] - first[i, j])
    # Make the axes orthonormal again: first z, then x, then y.
    for j in (2, 0):
        if j == 0:
            along = dot(column(out, 0), column(out, 2))
            for i in range(3):
                out[i, 0] -= along * out[i, 2]
        size = math.sqrt(dot(column(out, j), column(out, j)))
        for i in range(3):
            out[i, j] /= size
    out[0, 1], out[1, 1], out[2, 1] = cross(column(out, 2), column(out, 0))


@compiled()
def follow(
    links: FloatArray,
    task: int,
    targets: FloatArray,
    q: FloatArray,
    reached: IntArray,
    max_correction: float,
) -> None:
    """Follow poses from several joint positions by the shortest joint steps.

    A pose is reached if the correction is below `max_correction` [rad]. If corrections do not
    converge, the step to the pose is halved (step-length control of numerical continuation).

    - `targets`: (n, 3, 4), each close to the previous pose.
    - `q`: [rad], (branches, n, dof); the first pose of each branch is input, the others are output.
    - `reached`: output, number of reached poses of each branch, with the first.
    """
    branches, n, dof = q.shape
    frames = np.empty((len(links), 3, 4))
    square = np.empty((6, 6))
    right = np.empty(6)
    equations = PoseEquations(frames, np.empty((6, dof)), np.empty(6))
    step = np.empty(dof)
    current = np.empty(dof)
    trial = np.empty(dof)
    between = np.empty((3, 4))
    for branch in range(branches):
        reached[branch] = n
        for i in range(1, n):
            write_row(q[branch, i - 1], current)
            done = 0.0
            fraction = 1.0
            while done < 1.0 and fraction >= 0.5**MAX_FOLLOW_HALVINGS:
                ahead = min(done + fraction, 1.0)
                target = targets[i]
                if ahead < 1.0:
                    write_pose_between(targets[i - 1], targets[i], ahead, between)
                    target = between
                write_row(current, trial)
                size = math.inf
                before = math.inf
                for _ in range(FOLLOW_CORRECTIONS):
                    write_equations(links, task, trial, target, equations)
                    size = write_shortest_step(task, equations, 0.0, square, right, step)
                    # Each correction must be at most half of the previous one; otherwise the steps
                    # may end in another configuration.
                    if not size < 0.5 * before or size > FOLLOW_STEP:
                        break
                    for k in range(dof):
                        trial[k] += step[k]
                    before = size
                    if size < max_correction:
                        break
                if size < max_correction:
                    write_row(trial, current)
                    done = ahead
                    fraction = min(2.0 * fraction, 1.0)
                else:
                    fraction *= 0.5
            if done < 1.0:
                reached[branch] = i
                break
            write_row(current, q[branch, i])
