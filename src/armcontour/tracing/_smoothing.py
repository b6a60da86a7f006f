"""Compiled smoothing of joint positions along a path, by motion that does not move the tool."""

from __future__ import annotations

import math

import numpy as np

from armcontour._banded import solve_banded
from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.arms._newton import free_motions, newton

# Joint positions cost from this fraction of half the joint range on, with this weight relative to
# the length of the joint path.
INNER_RANGE = 0.7
RANGE_WEIGHT = 30.0
# Largest change of a joint position in one iteration of smoothing, about [rad].
LARGEST_CHANGE = 0.3
# Smoothing ends if an iteration changes no joint position by more than this [rad].
SETTLED = 1e-4
# Added to the diagonal of an iteration's matrix, relative to its largest entry; without it the
# matrix is singular if no cost depends on a null-space motion.
DAMPING = 1e-6
# Sums of many values: values that are added in one loop, and how often halves are halved at most.
BLOCK = 128
MOST_HALVES = 64


@compiled(inner=True)
def add_some(values: FloatArray) -> float:
    """Sum of at most BLOCK values, in eight sums beside each other."""
    n = len(values)
    found = 0.0
    some = n - n % 8
    if some:
        r0, r1, r2, r3 = values[0], values[1], values[2], values[3]
        r4, r5, r6, r7 = values[4], values[5], values[6], values[7]
        for i in range(8, some, 8):
            r0, r1 = r0 + values[i], r1 + values[i + 1]
            r2, r3 = r2 + values[i + 2], r3 + values[i + 3]
            r4, r5 = r4 + values[i + 4], r5 + values[i + 5]
            r6, r7 = r6 + values[i + 6], r7 + values[i + 7]
        found = ((r0 + r1) + (r2 + r3)) + ((r4 + r5) + (r6 + r7))
    for i in range(some, n):
        found += values[i]
    return found


@compiled(inner=True, allocates=True)
def add_up(values: FloatArray, n: int) -> float:
    """Sum of the first n values, half by half, in the order of numpy's sums.

    Joint positions that differ in a free turn of the tool cost the same, so that rounding errors
    decide which of them are taken: these are small, and the same on every machine.
    """
    sizes, firsts = np.empty(MOST_HALVES, np.intp), np.empty(MOST_HALVES)
    second = np.empty(MOST_HALVES, np.bool_)
    at = depth = 0
    sizes[0], second[0] = n, False
    while True:
        while sizes[depth] > BLOCK:
            half = sizes[depth] // 2
            depth += 1
            sizes[depth], second[depth] = half - half % 8, False
        value = add_some(values[at : at + sizes[depth]])
        at += sizes[depth]
        while depth > 0 and second[depth]:
            depth -= 1
            value = firsts[depth] + value
        if depth == 0:
            return value
        firsts[depth - 1] = value
        sizes[depth], second[depth] = sizes[depth - 1] - sizes[depth], True


@compiled(inner=True, allocates=True)
def write_weights(
    s: FloatArray, q: FloatArray, pace: FloatArray, memory: FloatArray, out: FloatArray
) -> None:
    """Write the weights of the joint steps in the cost into `out`, (n - 1,).

    A step may be as long as its share of the tool path and of the initial joint path: at a tight
    corner the joints move far on a short path, which must not outweigh all other steps.

    Args:
        s: Arc lengths [m], (n,).
        q: Joint positions [rad], (n, dof).
        pace: Smallest of the joints' largest velocities over each joint's own, (dof,).
        memory: Memory, (dof,) or more.
        out: Output: the weights.
    """
    n, dof = q.shape
    for i in range(n - 1):
        for k in range(dof):
            memory[k] = ((q[i + 1, k] - q[i, k]) * pace[k]) ** 2
        out[i] = math.sqrt(add_some(memory[:dof]))
    whole = add_up(out, n - 1)
    for i in range(n - 1):
        share = (s[i + 1] - s[i]) / (s[n - 1] - s[0])
        if whole > 0.0:
            share = share / 2.0 + out[i] / whole / 2.0
        out[i] = 1.0 / math.sqrt(share)


@compiled(inner=True, allocates=True)
def find_cost(
    q: FloatArray,
    pace: FloatArray,
    weights: FloatArray,
    middle: FloatArray,
    half: FloatArray,
    memory: FloatArray,
) -> float:
    """Sum of squares of the weighted joint steps and of the excess over the inner ranges."""
    n, dof = q.shape
    for i in range(n - 1):
        for k in range(dof):
            memory[i * dof + k] = ((q[i + 1, k] - q[i, k]) * pace[k] * weights[i]) ** 2
    length = add_up(memory, (n - 1) * dof)
    weight = RANGE_WEIGHT / math.sqrt(n)
    for i in range(n):
        for k in range(dof):
            beyond = abs((q[i, k] - middle[k]) / half[k]) - INNER_RANGE
            memory[i * dof + k] = (weight * beyond) ** 2 if beyond > 0.0 else 0.0
    return length + add_up(memory, n * dof)


@compiled(inner=True)
def write_equations(
    q: FloatArray,
    pace: FloatArray,
    weights: FloatArray,
    middle: FloatArray,
    half: FloatArray,
    i: int,
    gradient: FloatArray,
    weight: FloatArray,
    ahead: FloatArray,
) -> None:
    """Write half the gradient of the cost by joint positions i, and its second derivatives.

    Args:
        q: Joint positions [rad], (n, dof).
        pace: As in `write_weights`, (dof,).
        weights: Weights of the joint steps, (n - 1,).
        middle: Middles of the joint ranges, 0 of an endless one [rad], (dof,).
        half: Halves of the joint ranges [rad], (dof,).
        i: Index of the joint positions.
        gradient: Output: half the gradient, (dof,).
        weight: Output: half the second derivatives by the same joint, (dof,).
        ahead: Output: half the negative ones by the same joint at i + 1, (dof,).
    """
    n, dof = q.shape
    outside = RANGE_WEIGHT / math.sqrt(n)
    for k in range(dof):
        share = (q[i, k] - middle[k]) / half[k]
        beyond = abs(share) - INNER_RANGE
        slope = outside / half[k] if beyond > 0.0 else 0.0
        gradient[k], weight[k] = 0.0, slope * slope
        if beyond > 0.0:
            gradient[k] = slope * (outside * math.copysign(beyond, share))
        if i + 1 < n:
            ahead[k] = weights[i] * weights[i] * (pace[k] * pace[k])
            weight[k] += ahead[k]
            gradient[k] -= ahead[k] * (q[i + 1, k] - q[i, k])
        if i > 0:
            behind = weights[i - 1] * weights[i - 1] * (pace[k] * pace[k])
            weight[k] += behind
            gradient[k] += behind * (q[i, k] - q[i - 1, k])


@compiled(inner=True, allocates=True)
def write_system(
    q: FloatArray,
    w: FloatArray,
    pace: FloatArray,
    weights: FloatArray,
    middle: FloatArray,
    half: FloatArray,
    start_stays: bool,
    bands: FloatArray,
    right: FloatArray,
) -> None:
    """Write the equations of the null-space motion that minimizes the linearized cost.

    Their matrix is block tridiagonal and symmetric; the right side is half the negative gradient.

    Args:
        q: Joint positions [rad], (n, dof).
        w: Bases of the null space, (n, free, dof).
        pace: As in `write_weights`, (dof,).
        weights: Weights of the joint steps, (n - 1,).
        middle: Middles of the joint ranges, 0 of an endless one [rad], (dof,).
        half: Halves of the joint ranges [rad], (dof,).
        start_stays: Whether the first joint position is kept.
        bands: Output: the matrix below its diagonal, entry (r + k, r) in [r, k],
            (n free, 2 free).
        right: Output: the right side, (n free,).
    """
    n, free, dof = w.shape
    for row in range(n * free):
        for k in range(2 * free):
            bands[row, k] = 0.0
    gradient, weight, ahead = np.empty(dof), np.empty(dof), np.empty(dof)
    most = 0.0
    for i in range(n):
        write_equations(q, pace, weights, middle, half, i, gradient, weight, ahead)
        for a in range(free):
            row = i * free + a
            even = odd = 0.0
            for k in range(0, dof, 2):
                even += w[i, a, k] * gradient[k]
                if k + 1 < dof:
                    odd += w[i, a, k + 1] * gradient[k + 1]
            right[row] = -(even + odd)
            for k in range(dof):
                for b in range(a + 1):
                    bands[row + b - a, a - b] += w[i, a, k] * weight[k] * w[i, b, k]
                if i + 1 < n:
                    for b in range(free):
                        bands[row, free + b - a] -= w[i, a, k] * ahead[k] * w[i + 1, b, k]
            most = max(most, bands[row, 0])
    for row in range(n * free):
        bands[row, 0] += DAMPING * (1.0 + most)
    if start_stays:
        for row in range(free):
            right[row] = 0.0
            for k in range(2 * free):
                bands[row, k] = 1.0 if k == 0 else 0.0


@compiled()
def smooth(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    pace: FloatArray,
    s: FloatArray,
    poses: FloatArray,
    task: int,
    q: FloatArray,
    start_stays: bool,
    rounds: int,
) -> tuple[FloatArray, float]:
    """Joint positions with the same tool poses and a shorter joint path, by null-space motion.

    Args:
        rotations: Rotations of the joint frames, (dof, 3, 3).
        positions: Positions of the joint frames [m], (dof, 3).
        axes: Joint axes in the joint frames, (dof, 3).
        base: Base in the work frame, (3, 4).
        end: Tool in the frame of the last link, (3, 4).
        lower: Lower ends of the joint ranges, infinite without one [rad], (dof,).
        upper: Upper ends of the joint ranges [rad], (dof,).
        pace: Smallest of the joints' largest velocities over each joint's own, (dof,).
        s: Arc lengths [m], (n,).
        poses: Rotations and positions of the tool, (n, 3, 4).
        task: Task dimension: 6, 5 or 3.
        q: Joint positions at the poses [rad], (n, dof).
        start_stays: Whether the first joint position is kept.
        rounds: Largest number of iterations.

    Returns:
        The joint positions, (n, dof), and their cost.
    """
    n, dof = q.shape
    free = dof - task
    middle, half = np.empty(dof), np.empty(dof)
    for k in range(dof):
        middle[k], half[k] = 0.0, math.inf
        if math.isfinite(lower[k]) and math.isfinite(upper[k]):
            middle[k], half[k] = (upper[k] + lower[k]) / 2.0, (upper[k] - lower[k]) / 2.0
    weights, memory = np.empty(n - 1), np.empty(n * dof)
    write_weights(s, q, pace, memory, weights)
    cost = find_cost(q, pace, weights, middle, half, memory)
    bands, right = np.empty((n * free, 2 * free)), np.empty(n * free)
    goal = np.empty((n, 1, dof))
    for _ in range(rounds):
        w = free_motions(rotations, positions, axes, base, end, q, poses, task)
        write_system(q, w, pace, weights, middle, half, start_stays, bands, right)
        solve_banded(bands, right.reshape(-1, 1))
        size = 0.0
        for i in range(n):
            for k in range(dof):
                change = 0.0
                for a in range(free):
                    change += w[i, a, k] * right[i * free + a]
                goal[i, 0, k] = change
                size = max(size, abs(change))
        scale = min(1.0, LARGEST_CHANGE / max(size, 1e-12))
        trial = np.empty((n, dof))
        for i in range(n):
            for k in range(dof):
                goal[i, 0, k] = trial[i, k] = q[i, k] + scale * goal[i, 0, k]
        rows = w.reshape(n, 1, free, dof)
        found, _ = newton(rotations, positions, axes, base, end, trial, poses, task, rows, goal)
        count = 0
        for i in range(n):
            count += found[i]
        if count < n:
            break
        trial_cost = find_cost(trial, pace, weights, middle, half, memory)
        if not trial_cost < cost:
            break
        q, cost = trial, trial_cost
        if size < SETTLED:
            break
    return q, cost
