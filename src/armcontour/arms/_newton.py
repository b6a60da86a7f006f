"""The compiled inverse kinematics: Newton's method at many poses, and following a row of poses.

A pose asks for 6 things, or for 5 where turning about the tool axis is free, or for 3 where only
the tool point counts. Joints beyond that are told by further rows `w q = w g`, the guide.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.arms._chain import drift, jacobian, place

# Newton's method has arrived when its step is below this: the next one would be its square, times
# how badly the arm is conditioned there.
ARRIVED = 1e-10
MOST_STEPS = 15
# A step of more than this [rad] of any joint is shortened to it.
LONGEST_STEP = 0.5
# Following, one step moves no joint by more than this [rad], and takes so many corrections at most.
FOLLOW_STEP = 0.15
FOLLOW_CORRECTIONS = 6
# It is halved this often before the way on counts as lost.
MOST_HALVINGS = 12
# A pivot this small against the largest is none.
SINGULAR = 1e-11


@compiled()
def solve(a: FloatArray, b: FloatArray, n: int) -> float:
    """Solve a x = b in place by elimination; the solution is left in b.

    Args:
        a: (n, n), overwritten.
        b: (n, k), overwritten.
        n: Size.

    Returns:
        The smallest pivot over the largest: 0 where a is singular.
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
            for j in range(b.shape[1]):
                b[i, j], b[best, j] = b[best, j], b[i, j]
        pivot = a[i, i]
        least, most = min(least, abs(pivot)), max(most, abs(pivot))
        if pivot == 0.0 or not math.isfinite(pivot):
            return 0.0
        for k in range(i + 1, n):
            factor = a[k, i] / pivot
            if factor != 0.0:
                for j in range(i + 1, n):
                    a[k, j] -= factor * a[i, j]
                for j in range(b.shape[1]):
                    b[k, j] -= factor * b[i, j]
    for j in range(b.shape[1]):
        for i in range(n - 1, -1, -1):
            value = b[i, j]
            for k in range(i + 1, n):
                value -= a[i, k] * b[k, j]
            b[i, j] = value / a[i, i]
    return least / most


@compiled()
def missing(pose: FloatArray, target: FloatArray, task: int, out: FloatArray) -> None:
    """Write what is missing to a target pose into `out`, (task,): metres, then radians.

    Of a tool axis, the turn towards its target along the target's x and y.
    """
    for i in range(3):
        out[i] = target[i, 3] - pose[i, 3]
    if task == 6:
        # The turn from the pose to the target: the target times the pose transposed.
        v0 = v1 = v2 = c = 0.0
        for k in range(3):
            v0 += target[2, k] * pose[1, k] - target[1, k] * pose[2, k]
            v1 += target[0, k] * pose[2, k] - target[2, k] * pose[0, k]
            v2 += target[1, k] * pose[0, k] - target[0, k] * pose[1, k]
            c += target[0, k] * pose[0, k] + target[1, k] * pose[1, k] + target[2, k] * pose[2, k]
        s = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)  # twice the sine
        angle = math.atan2(s, c - 1.0)
        scale = angle / s if s > 1e-12 else 0.5
        if s <= 1e-12 and c < 0.0:
            # Half a turn: about any axis will do to leave it.
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


@compiled()
def write_task_rows(full: FloatArray, target: FloatArray, task: int, out: FloatArray) -> None:
    """Write the rows of the Jacobian that a target asks for into `out`, (task, dof)."""
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
    """Joint positions at poses, from guesses.

    Args:
        rotations: Of the chain, as in `place`.
        positions: Of the chain, as in `place`.
        axes: Of the chain, as in `place`.
        base: Base of the chain, as in `place`.
        end: Tool of the chain, as in `place`.
        q: Guesses, overwritten with what is found, (n, dof).
        targets: Poses, (n, 3, 4).
        task: 6, 5 or 3 of them.
        w: The guide's rows, (n, dof - task, dof).
        g: Joint positions of the guide, (n, dof).

    Returns:
        Whether each was found, (n,), and by how much the guess was off [rad], (n,).
    """
    n, dof = q.shape
    found = np.zeros(n, dtype=np.bool_)
    off = np.zeros(n)
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, scratch, full = np.empty((3, 4)), np.empty((3, 3, 3)), np.empty((6, dof))
    a, b, start = np.empty((dof, dof)), np.empty((dof, 1)), np.empty(dof)
    e = np.empty(6)
    for i in range(n):
        start[:] = q[i]
        for _ in range(MOST_STEPS):
            place(rotations, positions, axes, base, end, q[i], origins, directions, pose, scratch)
            jacobian(origins, directions, pose, full)
            missing(pose, targets[i], task, e)
            write_task_rows(full, targets[i], task, a)
            b[:task, 0] = e[:task]
            for r in range(dof - task):
                value = 0.0
                for k in range(dof):
                    a[task + r, k] = w[i, r, k]
                    value += w[i, r, k] * (g[i, k] - q[i, k])
                b[task + r, 0] = value
            if solve(a, b, dof) < SINGULAR:
                break
            size = 0.0
            for k in range(dof):
                size = max(size, abs(b[k, 0]))
            scale = LONGEST_STEP / size if size > LONGEST_STEP else 1.0
            for k in range(dof):
                q[i, k] += scale * b[k, 0]
            if size < ARRIVED:
                found[i] = True
                break
        for k in range(dof):
            off[i] = max(off[i], abs(q[i, k] - start[k]))
    return found, off


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
    """dq_ds and d2q_ds2 at joint positions that meet a path's poses.

    Where only the tool axis is asked for, `x . omega = x . rate` for the target's x and y, which
    turn with the target; the second derivative is that of these equations.

    Args:
        rotations: Of the chain, as in `place`.
        positions: Of the chain, as in `place`.
        axes: Of the chain, as in `place`.
        base: Base of the chain, as in `place`.
        end: Tool of the chain, as in `place`.
        q: Joint positions, (n, dof).
        targets: Poses, (n, 3, 4).
        rates: Of the targets with respect to s: velocity, acceleration, rate of turning and its
            derivative, (n, 4, 3).
        task: 6, 5 or 3 of them.
        w: The guide's rows and their first two derivatives, (n, 3, dof - task, dof).
        g: The guide and its first two derivatives, (n, 3, dof).

    Returns:
        dq_ds and d2q_ds2, (n, dof), and how far from singular each is, (n,): 0 is singular.
    """
    n, dof = q.shape
    first, second, apart = np.empty((n, dof)), np.empty((n, dof)), np.empty(n)
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, scratch, full = np.empty((3, 4)), np.empty((3, 3, 3)), np.empty((6, dof))
    a, copy, b = np.empty((dof, dof)), np.empty((dof, dof)), np.empty((dof, 1))
    carried, turn = np.empty(6), np.empty(3)
    for i in range(n):
        place(rotations, positions, axes, base, end, q[i], origins, directions, pose, scratch)
        jacobian(origins, directions, pose, full)
        target, rate = targets[i], rates[i]
        write_task_rows(full, target, task, a)
        for r in range(dof - task):
            a[task + r] = w[i, 0, r]
        copy[:] = a
        b[:3, 0] = rate[0]
        if task == 6:
            b[3:6, 0] = rate[2]
        elif task == 5:
            for j in range(2):
                b[3 + j, 0] = (
                    target[0, j] * rate[2, 0]
                    + target[1, j] * rate[2, 1]
                    + target[2, j] * rate[2, 2]
                )
        for r in range(dof - task):
            value = 0.0
            for k in range(dof):
                value += w[i, 0, r, k] * g[i, 1, k] - w[i, 1, r, k] * (q[i, k] - g[i, 0, k])
            b[task + r, 0] = value
        apart[i] = solve(copy, b, dof)
        first[i] = b[:, 0]
        drift(origins, directions, pose, first[i], carried)
        for k in range(3):
            b[k, 0] = rate[1, k] - carried[k]
        if task == 6:
            for k in range(3):
                b[3 + k, 0] = rate[3, k] - carried[3 + k]
        elif task == 5:
            # The tool turns about its axis at its own rate: the difference is along the axis.
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
                b[3 + j, 0] = (
                    vx * turn[0]
                    + vy * turn[1]
                    + vz * turn[2]
                    + x * (rate[3, 0] - carried[3])
                    + y * (rate[3, 1] - carried[4])
                    + z * (rate[3, 2] - carried[5])
                )
        for r in range(dof - task):
            value = 0.0
            for k in range(dof):
                value += (
                    w[i, 0, r, k] * g[i, 2, k]
                    - 2.0 * w[i, 1, r, k] * (first[i, k] - g[i, 1, k])
                    - w[i, 2, r, k] * (q[i, k] - g[i, 0, k])
                )
            b[task + r, 0] = value
        solve(a, b, dof)
        second[i] = b[:, 0]
    return first, second, apart


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
    """Joint motions that leave alone what is asked of the tool, orthonormal.

    Args:
        rotations: Of the chain, as in `place`.
        positions: Of the chain, as in `place`.
        axes: Of the chain, as in `place`.
        base: Base of the chain, as in `place`.
        end: Tool of the chain, as in `place`.
        q: Joint positions, (n, dof).
        targets: Poses, (n, 3, 4).
        task: 6, 5 or 3 of them.

    Returns:
        (n, dof - task, dof).
    """
    n, dof = q.shape
    found = np.empty((n, dof - task, dof))
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, scratch, full = np.empty((3, 4)), np.empty((3, 3, 3)), np.empty((6, dof))
    rows, rest = np.empty((dof, dof)), np.empty(dof)
    for i in range(n):
        place(rotations, positions, axes, base, end, q[i], origins, directions, pose, scratch)
        jacobian(origins, directions, pose, full)
        write_task_rows(full, targets[i], task, rows)
        for r in range(dof):
            if r >= task:
                # Next, the joint of which the rows so far hold least.
                rest[:] = 1.0
                for j in range(r):
                    for k in range(dof):
                        rest[k] -= rows[j, k] ** 2
                rows[r] = 0.0
                rows[r, np.argmax(rest)] = 1.0
            # Twice is enough to be at right angles to the last digit.
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
        found[i] = rows[task:]
    return found


@compiled()
def least_step(
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
    """Write the shortest joint step that makes up for `e` into `out`; returns its largest part.

    `J^T (J J^T + damping² I)^-1 e`; it is long or not finite where the arm is singular.
    """
    dof = full.shape[1]
    write_task_rows(full, target, task, rows)
    for i in range(task):
        for j in range(task):
            value = damping * damping if i == j else 0.0
            for k in range(dof):
                value += rows[i, k] * rows[j, k]
            square[i, j] = value
        right[i, 0] = e[i]
    if solve(square, right, task) == 0.0:
        return math.inf
    most = 0.0
    for k in range(dof):
        value = 0.0
        for i in range(task):
            value += rows[i, k] * right[i, 0]
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
    """Bring every row of joint positions as near to one pose as it gets, by damped least squares.

    Args:
        rotations: Of the chain, as in `place`.
        positions: Of the chain, as in `place`.
        axes: Of the chain, as in `place`.
        base: Base of the chain, as in `place`.
        end: Tool of the chain, as in `place`.
        target: The pose, (3, 4).
        task: 6, 5 or 3 of it.
        q: Where each starts, overwritten with where it ends, (n, dof).
        weight: Metres that count as much as a radian.
        most: Largest number of steps.

    Returns:
        What is missing in the end, (n, 2) [m, rad].
    """
    n, dof = q.shape
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, scratch, full = np.empty((3, 4)), np.empty((3, 3, 3)), np.empty((6, dof))
    rows, square, right = np.empty((6, dof)), np.empty((6, 6)), np.empty((6, 1))
    step, trial, e = np.empty(dof), np.empty(dof), np.zeros(6)
    left = np.empty((n, 2))
    for i in range(n):
        damping = 0.05
        cost = math.inf
        trial[:] = q[i]
        for _ in range(most):
            place(rotations, positions, axes, base, end, trial, origins, directions, pose, scratch)
            missing(pose, target, task, e)
            value = 0.0
            for k in range(task):
                if k >= 3:
                    e[k] *= weight
                value += e[k] * e[k]
            if value < cost:
                gain = cost - value
                cost = value
                q[i] = trial
                damping = max(damping * 0.3, 1e-9)
                if cost < 1e-26 or gain < 1e-12 * cost:
                    break
                jacobian(origins, directions, pose, full)
                full[3:] *= weight
            else:
                damping *= 4.0
                if damping > 1e3:
                    break
                # The state to step from has not changed, but e is that of the trial.
                place(
                    rotations, positions, axes, base, end, q[i], origins, directions, pose, scratch
                )
                missing(pose, target, task, e)
                for k in range(3, task):
                    e[k] *= weight
            size = least_step(full, target, e, task, damping, rows, square, right, step)
            if not math.isfinite(size):
                break
            scale = LONGEST_STEP / size if size > LONGEST_STEP else 1.0
            for k in range(dof):
                trial[k] = q[i, k] + scale * step[k]
        place(rotations, positions, axes, base, end, q[i], origins, directions, pose, scratch)
        missing(pose, target, task, e)
        left[i, 0] = math.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
        turn = 0.0
        for k in range(3, task):
            turn += e[k] ** 2
        left[i, 1] = math.sqrt(turn)
    return left


@compiled()
def between(first: FloatArray, second: FloatArray, share: float, out: FloatArray) -> None:
    """Write a pose between two that are near each other into `out`, (3, 4)."""
    for i in range(3):
        for j in range(4):
            out[i, j] = first[i, j] + share * (second[i, j] - first[i, j])
    # Axes at right angles again: z first, then x.
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
) -> int:
    """Follow a row of poses from the first joint position, by the shortest joint steps.

    Args:
        rotations: Of the chain, as in `place`.
        positions: Of the chain, as in `place`.
        axes: Of the chain, as in `place`.
        base: Base of the chain, as in `place`.
        end: Tool of the chain, as in `place`.
        targets: Poses near to their neighbours, (n, 3, 4).
        task: 6, 5 or 3 of them.
        q: Joint positions, of which the first is given and the others are found, (n, dof).

    Returns:
        How many poses were reached, the first among them.
    """
    n, dof = q.shape
    origins, directions = np.empty((dof, 3)), np.empty((dof, 3))
    pose, scratch, full = np.empty((3, 4)), np.empty((3, 3, 3)), np.empty((6, dof))
    rows, square, right = np.empty((6, dof)), np.empty((6, 6)), np.empty((6, 1))
    step, here, trial, e = np.empty(dof), np.empty(dof), np.empty(dof), np.zeros(6)
    target = np.empty((3, 4))
    smallest = 0.5**MOST_HALVINGS
    for i in range(1, n):
        here[:] = q[i - 1]
        done, share = 0.0, 1.0
        while done < 1.0:
            ahead = min(done + share, 1.0)
            between(targets[i - 1], targets[i], ahead, target)
            if ahead == 1.0:
                target[:] = targets[i]
            trial[:] = here
            arrived = False
            before = math.inf
            for _ in range(FOLLOW_CORRECTIONS):
                place(
                    rotations, positions, axes, base, end, trial, origins, directions, pose, scratch
                )
                jacobian(origins, directions, pose, full)
                missing(pose, target, task, e)
                size = least_step(full, target, e, task, 0.0, rows, square, right, step)
                # Corrections shrink by half at least, or the way may lead to another solution.
                if not size < 0.5 * before or size > FOLLOW_STEP:
                    arrived = size < 1e-9
                    break
                trial += step
                before = size
                if size < 1e-9:
                    arrived = True
                    break
            if arrived:
                here[:] = trial
                done = ahead
                share = min(2.0 * share, 1.0)
            else:
                share *= 0.5
                if share < smallest:
                    return i
        q[i] = here
    return len(targets)


@compiled()
def distinct(solutions: FloatArray, apart: float) -> IntArray:
    """Indices of joint positions that differ from all before them by more than `apart` [rad].

    Whole turns do not count.
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
