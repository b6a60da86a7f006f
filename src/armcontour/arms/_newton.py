"""Compiled inverse kinematics: Newton's method, damped least squares, following of pose sequences.

The task dimension is the number of equations that a target pose gives: 6; 5 if rotation about the
tool axis is free; 3 if only the tool point counts. If the arm has more joints than that, guide
equations `w q = w g` fix the redundant degrees of freedom: w are the guide's rows, g the guide's
joint positions.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.arms._chain import write_bias_acceleration, write_jacobian, write_kinematics

# Newton's method ends when its step is below this [rad]: the next step would be the square of this
# one times the condition number of the Jacobian.
ARRIVED = 1e-10
MOST_STEPS = 15
# Longest step of any joint [rad]; longer steps are shortened.
LONGEST_STEP = 0.5
# `follow`: longest correction of any joint [rad], and largest number of corrections per step.
FOLLOW_STEP = 0.15
FOLLOW_CORRECTIONS = 6
# `follow` gives up after it has halved the step between two poses this many times.
MOST_HALVINGS = 12
# A matrix counts as singular if its smallest pivot over its largest one is below this.
SINGULAR = 1e-11


@compiled(inner=True)
def solve(a: FloatArray, b: FloatArray, n: int) -> float:
    """Solve a x = b in place by Gaussian elimination with pivoting.

    Args:
        a: Matrix, (n, n), overwritten.
        b: Right-hand side, (n,), overwritten with the solution.
        n: Number of equations.

    Returns:
        The smallest pivot over the largest pivot; 0 if a is singular.
    """
    least, most = math.inf, 0.0
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
        least, most = min(least, abs(pivot)), max(most, abs(pivot))
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
    return least / most


@compiled(inner=True)
def write_row(row: FloatArray, out: FloatArray) -> None:
    """Write numbers into another array; assignments of whole arrays take long to compile."""
    for k in range(len(row)):
        out[k] = row[k]


@compiled(inner=True)
def write_pose_error(pose: FloatArray, target: FloatArray, task: int, out: FloatArray) -> None:
    """Write the position and orientation error from a pose to its target into `out`, (task,).

    The first 3 values are the position error [m]. For task 6 the others are the rotation vector
    from the pose to the target [rad]. For task 5 they are the components of the rotation vector
    between the tool axes along the target's x and y axes [rad].

    Args:
        pose: Pose of the tool, (3, 4).
        target: Target pose, (3, 4).
        task: Task dimension: 6, 5 or 3.
        out: Output: the error, (task,) or longer.
    """
    for i in range(3):
        out[i] = target[i, 3] - pose[i, 3]
    if task == 6:
        # The rotation from the pose to the target: the target times the transposed pose.
        v0 = v1 = v2 = c = 0.0
        for k in range(3):
            v0 += target[2, k] * pose[1, k] - target[1, k] * pose[2, k]
            v1 += target[0, k] * pose[2, k] - target[2, k] * pose[0, k]
            v2 += target[1, k] * pose[0, k] - target[0, k] * pose[1, k]
            c += target[0, k] * pose[0, k] + target[1, k] * pose[1, k] + target[2, k] * pose[2, k]
        s = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)  # twice the sine of the angle
        angle = math.atan2(s, c - 1.0)
        scale = angle / s if s > 1e-12 else 0.5
        if s <= 1e-12 and c < 0.0:
            # At half a turn the axis is undefined; a rotation about any axis makes progress.
            v0, v1, v2, scale = 1.0, 0.0, 0.0, math.pi
        out[3], out[4], out[5] = scale * v0, scale * v1, scale * v2
    elif task == 5:
        v0 = pose[1, 2] * target[2, 2] - pose[2, 2] * target[1, 2]
        v1 = pose[2, 2] * target[0, 2] - pose[0, 2] * target[2, 2]
        v2 = pose[0, 2] * target[1, 2] - pose[1, 2] * target[0, 2]
        c = pose[0, 2] * target[0, 2] + pose[1, 2] * target[1, 2] + pose[2, 2] * target[2, 2]
        s = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        scale = math.atan2(s, c) / s if s > 1e-12 else 1.0
        if s <= 1e-12 and c < 0.0:
            v0, v1, v2, scale = target[0, 0], target[1, 0], target[2, 0], math.pi
        for j in range(2):
            out[3 + j] = scale * (v0 * target[0, j] + v1 * target[1, j] + v2 * target[2, j])


@compiled(inner=True)
def write_task_rows(full: FloatArray, target: FloatArray, task: int, out: FloatArray) -> None:
    """Write those rows of the Jacobian that a task has equations for into `out`, (task, dof).

    The rows belong to the values of `write_pose_error`.

    Args:
        full: Geometric Jacobian, (6, dof).
        target: Target pose, (3, 4).
        task: Task dimension: 6, 5 or 3.
        out: Output: the rows.
    """
    dof = full.shape[1]
    for k in range(dof):
        for i in range(3):
            out[i, k] = full[i, k]
        if task == 6:
            for i in range(3, 6):
                out[i, k] = full[i, k]
        elif task == 5:
            for j in range(2):
                out[3 + j, k] = (
                    full[3, k] * target[0, j]
                    + full[4, k] * target[1, j]
                    + full[5, k] * target[2, j]
                )


@compiled()
def newton(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    targets: FloatArray,
    task: int,
    w: FloatArray,
    g: FloatArray,
) -> tuple[BoolArray, FloatArray]:
    """Solve the inverse kinematics at many poses by Newton's method from initial guesses.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        q: Initial guesses of the joint positions [rad], overwritten with the results, (n, dof).
        targets: Target poses, (n, 3, 4).
        task: Task dimension: 6, 5 or 3.
        w: Rows of the guide equations in [:, 0], (n, 1 or 3, dof - task, dof); derivatives are
            not used.
        g: Joint positions of the guide in [:, 0] [rad], (n, 1 or 3, dof).

    Returns:
        Whether a solution was found for each pose, (n,), and the largest difference of a joint
        between guess and result [rad], (n,).
    """
    n, dof = q.shape
    found, change = np.empty(n, np.bool_), np.empty(n)
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, full = np.empty((3, 4)), np.empty((6, dof))
    a, b, start = np.empty((dof, dof)), np.empty(dof), np.empty(dof)
    e = np.empty(6)
    for i in range(n):
        write_row(q[i], start)
        found[i], change[i] = False, 0.0
        for _ in range(MOST_STEPS):
            write_kinematics(rotations, positions, axes, base, end, q[i], origins, directions, pose)
            write_jacobian(origins, directions, pose, full)
            write_pose_error(pose, targets[i], task, e)
            write_task_rows(full, targets[i], task, a)
            for k in range(task):
                b[k] = e[k]
            for r in range(dof - task):
                value = 0.0
                for k in range(dof):
                    a[task + r, k] = w[i, 0, r, k]
                    value += w[i, 0, r, k] * (g[i, 0, k] - q[i, k])
                b[task + r] = value
            if solve(a, b, dof) < SINGULAR:
                break
            size = 0.0
            for k in range(dof):
                size = max(size, abs(b[k]))
            scale = LONGEST_STEP / size if size > LONGEST_STEP else 1.0
            for k in range(dof):
                q[i, k] += scale * b[k]
            if size < ARRIVED:
                found[i] = True
                break
        for k in range(dof):
            change[i] = max(change[i], abs(q[i, k] - start[k]))
    return found, change


@compiled()
def path_derivatives(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    targets: FloatArray,
    rates: FloatArray,
    task: int,
    w: FloatArray,
    g: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives of the joint positions by arc length s, at the poses of a path.

    If rotation about the tool axis is free, the equations of the orientation are
    `x . omega = x . rate` for the target's x and y axes, which rotate with the target. The second
    derivative follows from differentiating these equations.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        q: Joint positions that solve the inverse kinematics [rad], (n, dof).
        targets: Target poses, (n, 3, 4).
        rates: Derivatives of the targets by s: first and second of the position, angular velocity
            and its derivative, (n, 4, 3).
        task: Task dimension: 6, 5 or 3.
        w: Rows of the guide equations and their first two derivatives by s,
            (n, 3, dof - task, dof).
        g: Joint positions of the guide and their first two derivatives by s, (n, 3, dof).

    Returns:
        dq_ds [rad/m] and d2q_ds2 [rad/m²], (n, dof), and the smallest over the largest pivot of
        the equations, (n,): 0 if they are singular.
    """
    n, dof = q.shape
    first, second, pivot_ratio = np.empty((n, dof)), np.empty((n, dof)), np.empty(n)
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, full = np.empty((3, 4)), np.empty((6, dof))
    a, copy, b = np.empty((dof, dof)), np.empty((dof, dof)), np.empty(dof)
    bias, turn = np.empty(6), np.empty(3)
    for i in range(n):
        write_kinematics(rotations, positions, axes, base, end, q[i], origins, directions, pose)
        write_jacobian(origins, directions, pose, full)
        target, rate = targets[i], rates[i]
        write_task_rows(full, target, task, a)
        for r in range(dof - task):
            write_row(w[i, 0, r], a[task + r])
        for k in range(dof):
            write_row(a[k], copy[k])
        for k in range(3):
            b[k] = rate[0, k]
            if task == 6:
                b[3 + k] = rate[2, k]
        if task == 5:
            for j in range(2):
                b[3 + j] = (
                    target[0, j] * rate[2, 0]
                    + target[1, j] * rate[2, 1]
                    + target[2, j] * rate[2, 2]
                )
        for r in range(dof - task):
            value = 0.0
            for k in range(dof):
                value += w[i, 0, r, k] * g[i, 1, k] - w[i, 1, r, k] * (q[i, k] - g[i, 0, k])
            b[task + r] = value
        pivot_ratio[i] = solve(copy, b, dof)
        write_row(b, first[i])
        write_bias_acceleration(origins, directions, pose, first[i], bias)
        for k in range(3):
            b[k] = rate[1, k] - bias[k]
        if task == 6:
            for k in range(3):
                b[3 + k] = rate[3, k] - bias[3 + k]
        elif task == 5:
            # The tool may rotate about its axis at another rate than the target: the difference of
            # the angular velocities is along the tool axis.
            for k in range(3):
                value = rate[2, k]
                for j in range(dof):
                    value -= full[3 + k, j] * first[i, j]
                turn[k] = value
            for j in range(2):
                x, y, z = target[0, j], target[1, j], target[2, j]
                vx = rate[2, 1] * z - rate[2, 2] * y
                vy = rate[2, 2] * x - rate[2, 0] * z
                vz = rate[2, 0] * y - rate[2, 1] * x
                b[3 + j] = (
                    vx * turn[0]
                    + vy * turn[1]
                    + vz * turn[2]
                    + x * (rate[3, 0] - bias[3])
                    + y * (rate[3, 1] - bias[4])
                    + z * (rate[3, 2] - bias[5])
                )
        for r in range(dof - task):
            value = 0.0
            for k in range(dof):
                value += (
                    w[i, 0, r, k] * g[i, 2, k]
                    - 2.0 * w[i, 1, r, k] * (first[i, k] - g[i, 1, k])
                    - w[i, 2, r, k] * (q[i, k] - g[i, 0, k])
                )
            b[task + r] = value
        solve(a, b, dof)
        write_row(b, second[i])
    return first, second, pivot_ratio


@compiled()
def free_motions(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    q: FloatArray,
    targets: FloatArray,
    task: int,
) -> FloatArray:
    """Orthonormal basis of the null-space motion: joint motion that does not move the tool.

    For task 5 the tool may rotate about its axis, for task 3 about its tool point.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        q: Joint positions [rad], (n, dof).
        targets: Target poses, (n, 3, 4).
        task: Task dimension: 6, 5 or 3.

    Returns:
        Unit vectors of joint motion, (n, dof - task, dof).
    """
    n, dof = q.shape
    found = np.empty((n, dof - task, dof))
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, full = np.empty((3, 4)), np.empty((6, dof))
    rows, rest = np.empty((dof, dof)), np.empty(dof)
    for i in range(n):
        write_kinematics(rotations, positions, axes, base, end, q[i], origins, directions, pose)
        write_jacobian(origins, directions, pose, full)
        write_task_rows(full, targets[i], task, rows)
        for r in range(dof):
            if r >= task:
                # Start from the joint axis that is farthest from the span of the rows so far.
                farthest = 0
                for k in range(dof):
                    rest[k], rows[r, k] = 1.0, 0.0
                    for j in range(r):
                        rest[k] -= rows[j, k] ** 2
                    if rest[k] > rest[farthest]:
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
            write_row(rows[r], found[i, r - task])
    return found


@compiled(inner=True)
def write_shortest_step(
    full: FloatArray,
    target: FloatArray,
    e: FloatArray,
    task: int,
    damping: float,
    rows: FloatArray,
    square: FloatArray,
    right: FloatArray,
    out: FloatArray,
) -> float:
    """Write the shortest joint step that removes the pose error `e` into `out`.

    The step is `J^T (J J^T + damping² I)^-1 e`; it is long or not finite near a singularity.

    Args:
        full: Geometric Jacobian, (6, dof).
        target: Target pose, (3, 4).
        e: Pose error as in `write_pose_error`, (task,).
        task: Task dimension: 6, 5 or 3.
        damping: Damping of the least squares.
        rows: Memory for the Jacobian of the pose error, (6, dof).
        square: Memory, (6, 6).
        right: Memory, (6,).
        out: Output: the step [rad], (dof,).

    Returns:
        The largest step of a joint [rad]; infinite if the equations are singular.
    """
    dof = full.shape[1]
    write_task_rows(full, target, task, rows)
    for i in range(task):
        for j in range(i + 1):
            value = damping * damping if i == j else 0.0
            for k in range(dof):
                value += rows[i, k] * rows[j, k]
            square[i, j] = square[j, i] = value
        right[i] = e[i]
    if solve(square, right, task) == 0.0:
        return math.inf
    most = 0.0
    for k in range(dof):
        value = 0.0
        for i in range(task):
            value += rows[i, k] * right[i]
        out[k] = value
        most = max(most, abs(value))
    return most


@compiled()
def approach(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    target: FloatArray,
    task: int,
    q: FloatArray,
    weight: float,
    most: int,
) -> FloatArray:
    """Move each row of joint positions as close to one pose as possible, by damped least squares.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        target: Target pose, (3, 4).
        task: Task dimension: 6, 5 or 3.
        q: Joint positions to start from [rad], overwritten with the results, (n, dof).
        weight: Weight of a radian against a metre [m/rad].
        most: Largest number of steps.

    Returns:
        Position and orientation error that remain, (n, 2) [m, rad].
    """
    n, dof = q.shape
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, full = np.empty((3, 4)), np.empty((6, dof))
    rows, square, right = np.empty((6, dof)), np.empty((6, 6)), np.empty(6)
    step, trial, e = np.empty(dof), np.empty(dof), np.empty(6)
    residual = np.empty((n, 2))
    for i in range(n):
        damping = 0.05
        cost = math.inf
        write_row(q[i], trial)
        for _ in range(most):
            write_kinematics(
                rotations, positions, axes, base, end, trial, origins, directions, pose
            )
            write_pose_error(pose, target, task, e)
            value = 0.0
            for k in range(task):
                if k >= 3:
                    e[k] *= weight
                value += e[k] * e[k]
            if value < cost:
                gain = cost - value
                cost = value
                write_row(trial, q[i])
                damping = max(damping * 0.3, 1e-9)
                if cost < 1e-26 or gain < 1e-12 * cost:
                    break
                write_jacobian(origins, directions, pose, full)
                for r in range(3, 6):
                    for k in range(dof):
                        full[r, k] *= weight
            else:
                damping *= 4.0
                if damping > 1e3:
                    break
                # The step starts from q[i] again, so e of the rejected trial is computed anew.
                write_kinematics(
                    rotations, positions, axes, base, end, q[i], origins, directions, pose
                )
                write_pose_error(pose, target, task, e)
                for k in range(3, task):
                    e[k] *= weight
            size = write_shortest_step(full, target, e, task, damping, rows, square, right, step)
            if not math.isfinite(size):
                break
            scale = LONGEST_STEP / size if size > LONGEST_STEP else 1.0
            for k in range(dof):
                trial[k] = q[i, k] + scale * step[k]
        write_kinematics(rotations, positions, axes, base, end, q[i], origins, directions, pose)
        write_pose_error(pose, target, task, e)
        residual[i, 0] = math.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
        turn = 0.0
        for k in range(3, task):
            turn += e[k] ** 2
        residual[i, 1] = math.sqrt(turn)
    return residual


@compiled(inner=True)
def write_pose_between(
    first: FloatArray, second: FloatArray, share: float, out: FloatArray
) -> None:
    """Write the pose at `share` (0 to 1) from the first to the second of two close poses."""
    for i in range(3):
        for j in range(4):
            out[i, j] = first[i, j] + share * (second[i, j] - first[i, j])
    # Make the axes orthonormal again: first z, then x, then y.
    for j in (2, 0):
        if j == 0:
            along = out[0, 0] * out[0, 2] + out[1, 0] * out[1, 2] + out[2, 0] * out[2, 2]
            for i in range(3):
                out[i, 0] -= along * out[i, 2]
        size = math.sqrt(out[0, j] ** 2 + out[1, j] ** 2 + out[2, j] ** 2)
        for i in range(3):
            out[i, j] /= size
    out[0, 1] = out[1, 2] * out[2, 0] - out[2, 2] * out[1, 0]
    out[1, 1] = out[2, 2] * out[0, 0] - out[0, 2] * out[2, 0]
    out[2, 1] = out[0, 2] * out[1, 0] - out[1, 2] * out[0, 0]


@compiled()
def follow(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    targets: FloatArray,
    task: int,
    q: FloatArray,
    reached: IntArray,
    enough: float,
) -> None:
    """Follow a sequence of poses from several joint positions by the shortest joint steps.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        targets: Target poses, each close to the one before, (n, 3, 4).
        task: Task dimension: 6, 5 or 3.
        q: Joint positions of every way [rad], (ways, n, dof): rows 0 are given, the other rows are
            outputs, as far as poses are reached.
        reached: Takes the number of poses that were reached, including the first one, (ways,).
        enough: A pose is reached with a correction below this [rad].
    """
    ways, n, dof = q.shape
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, full = np.empty((3, 4)), np.empty((6, dof))
    rows, square, right = np.empty((6, dof)), np.empty((6, 6)), np.empty(6)
    step, here, trial, e = np.empty(dof), np.empty(dof), np.empty(dof), np.empty(6)
    target = np.empty((3, 4))
    smallest = 0.5**MOST_HALVINGS
    for way in range(ways):
        reached[way] = n
        for i in range(1, n):
            write_row(q[way, i - 1], here)
            done, share = 0.0, 1.0
            while done < 1.0:
                ahead = min(done + share, 1.0)
                if ahead < 1.0:
                    write_pose_between(targets[i - 1], targets[i], ahead, target)
                else:
                    for r in range(3):
                        write_row(targets[i, r], target[r])
                write_row(here, trial)
                arrived = False
                before = math.inf
                for _ in range(FOLLOW_CORRECTIONS):
                    write_kinematics(
                        rotations, positions, axes, base, end, trial, origins, directions, pose
                    )
                    write_jacobian(origins, directions, pose, full)
                    write_pose_error(pose, target, task, e)
                    size = write_shortest_step(
                        full, target, e, task, 0.0, rows, square, right, step
                    )
                    # Each correction must be at most half of the one before; otherwise the steps
                    # may lead to another configuration.
                    if not size < 0.5 * before or size > FOLLOW_STEP:
                        arrived = size < enough
                        break
                    for k in range(dof):
                        trial[k] += step[k]
                    before = size
                    if size < enough:
                        arrived = True
                        break
                if arrived:
                    write_row(trial, here)
                    done = ahead
                    share = min(2.0 * share, 1.0)
                else:
                    share *= 0.5
                    if share < smallest:
                        reached[way] = i
                        break
            if reached[way] < n:
                break
            write_row(here, q[way, i])


@compiled()
def distinct(solutions: FloatArray, apart: float) -> IntArray:
    """Indices of the distinct solutions, without those that repeat a solution before them.

    Args:
        solutions: Joint positions [rad], (n, dof).
        apart: Solutions are distinct if a joint differs by more than this [rad], up to whole turns.
    """
    n, dof = solutions.shape
    kept = np.empty(n, dtype=np.intp)
    count = 0
    for i in range(n):
        fresh = True
        for k in range(count):
            most = 0.0
            for j in range(dof):
                d = abs(solutions[i, j] - solutions[kept[k], j]) % (2.0 * math.pi)
                most = max(most, min(d, 2.0 * math.pi - d))
            if most <= apart:
                fresh = False
                break
        if fresh:
            kept[count] = i
            count += 1
    return kept[:count]
