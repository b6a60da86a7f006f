"""Joint positions of a pose in closed form, for six joints of which 2 and 3 are parallel.

Either joint 4 is parallel to them and the axes 5 and 6 meet, as in the arms of Universal Robots, or
the axes 4, 5 and 6 meet in a wrist. Axes and points are those with all joints at 0, in the frame of
the base; the formulas are products of rotations about these axes (Murray, Li and Sastry, 1994).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

Vector: TypeAlias = tuple[float, float, float]

# What is nearer than this to the end of a reach, or to a posture in which axes meet, is not decided
# here [m, 1].
NEAR = 1e-6
# Rows of the table of an arm: axes, points on them, the centre, and its end with all joints at 0:
# the rotation back to the end's frame, and its position.
AXES, POINTS, CENTER, BACK, END = 0, 6, 12, 13, 16
ROWS = 17
MOST = 8


@compiled(inner=True)
def row(table: FloatArray, k: int) -> Vector:
    """A row as a vector."""
    return table[k, 0], table[k, 1], table[k, 2]


@compiled(inner=True)
def minus(a: Vector, b: Vector) -> Vector:
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled(inner=True)
def plus(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled(inner=True)
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(inner=True)
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@compiled(inner=True)
def turn(axis: Vector, angle: float, v: Vector) -> Vector:
    """A vector turned about an axis, by Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    along = (1.0 - c) * dot(axis, v)
    w = cross(axis, v)
    return (
        c * v[0] + s * w[0] + along * axis[0],
        c * v[1] + s * w[1] + along * axis[1],
        c * v[2] + s * w[2] + along * axis[2],
    )


@compiled(inner=True)
def across(axis: Vector, v: Vector) -> Vector:
    """The part of a vector at right angles to an axis."""
    along = dot(axis, v)
    return v[0] - along * axis[0], v[1] - along * axis[1], v[2] - along * axis[2]


@compiled(inner=True)
def angle_about(axis: Vector, a: Vector, b: Vector) -> float:
    """The angle about an axis from one vector to another [rad]."""
    return math.atan2(dot(axis, cross(a, b)), dot(across(axis, a), across(axis, b)))


@compiled(inner=True)
def turned_back(rotation: FloatArray, v: Vector) -> Vector:
    """A vector in the frame whose axes are the columns of a matrix, (3, 3) or (3, 4)."""
    return (
        rotation[0, 0] * v[0] + rotation[1, 0] * v[1] + rotation[2, 0] * v[2],
        rotation[0, 1] * v[0] + rotation[1, 1] * v[1] + rotation[2, 1] * v[2],
        rotation[0, 2] * v[0] + rotation[1, 2] * v[1] + rotation[2, 2] * v[2],
    )


@compiled(inner=True)
def turned_out(rotation: FloatArray, v: Vector) -> Vector:
    """A vector given in the frame whose axes are the columns of a matrix."""
    return (
        rotation[0, 0] * v[0] + rotation[0, 1] * v[1] + rotation[0, 2] * v[2],
        rotation[1, 0] * v[0] + rotation[1, 1] * v[1] + rotation[1, 2] * v[2],
        rotation[2, 0] * v[0] + rotation[2, 1] * v[1] + rotation[2, 2] * v[2],
    )


@compiled(inner=True)
def moved(arm: FloatArray, base: FloatArray, pose: FloatArray, v: Vector) -> Vector:
    """A vector that is fixed in the last link, turned as the joints turn it for a pose."""
    return turned_back(base, turned_out(pose, turned_out(arm[BACK:END], v)))


@compiled(inner=True)
def center_at(arm: FloatArray, base: FloatArray, pose: FloatArray) -> Vector:
    """Where the centre is at a pose, in the frame of the base."""
    there = (pose[0, 3] - base[0, 3], pose[1, 3] - base[1, 3], pose[2, 3] - base[2, 3])
    end = turned_back(base, there)
    return plus(end, moved(arm, base, pose, minus(row(arm, CENTER), row(arm, END))))


@compiled(inner=True)
def meet(axis: Vector, v: Vector, along: Vector, wanted: float) -> tuple[float, float, float]:
    """Angles about an axis by which a vector is turned to have a component along a direction.

    Returns:
        How much of the component is lacking, below 0 if there are two angles; and the angles, one
        of them twice where it is lacking [rad].
    """
    fixed = dot(axis, v) * dot(axis, along)
    a, b = dot(along, v) - fixed, dot(along, cross(axis, v))
    size = math.hypot(a, b)
    needed = wanted - fixed
    middle = math.atan2(b, a)
    if abs(needed) >= size:
        half = 0.0 if needed > 0 else math.pi
    else:
        half = math.acos(needed / size)
    return abs(needed) - size, middle + half, middle - half


@compiled(inner=True)
def lengths(arm: FloatArray, normal: Vector, last: Vector) -> tuple[Vector, Vector]:
    """The upper arm and the forearm, up to a point, in the plane in which they move."""
    elbow = row(arm, POINTS + 2)
    upper = across(normal, minus(elbow, row(arm, POINTS + 1)))
    return upper, across(normal, minus(last, elbow))


@compiled(inner=True)
def gap_of(arm: FloatArray, normal: Vector, last: Vector, reached: Vector) -> float:
    """How far upper arm and forearm are from bringing a point where it is wanted [m]."""
    upper, fore = lengths(arm, normal, last)
    a, b = math.sqrt(dot(upper, upper)), math.sqrt(dot(fore, fore))
    way = across(normal, minus(reached, row(arm, POINTS + 1)))
    size = math.sqrt(dot(way, way))
    return max(size - a - b, abs(a - b) - size)


@compiled(inner=True)
def least_gap(arm: FloatArray, wrist: bool, base: FloatArray, pose: FloatArray) -> float:
    """How far a pose is out of reach at least [m]; 0 or less where it may be within reach."""
    first, normal = row(arm, AXES), row(arm, AXES + 1)
    center, foot = row(arm, CENTER), row(arm, POINTS)
    fifth, sixth, joint = row(arm, AXES + 4), row(arm, AXES + 5), row(arm, POINTS + 3)
    way = minus(center_at(arm, base, pose), foot)
    pointing = moved(arm, base, pose, sixth)
    # Turning the first joint back brings the centre into the plane of upper arm and forearm.
    lacking, one, other = meet(first, way, normal, dot(normal, minus(center, foot)))
    if lacking > -NEAR:
        return lacking if lacking > NEAR else 0.0
    least = math.inf
    for back in (one, other):
        there = plus(foot, turn(first, back, way))
        if wrist:
            least = min(least, gap_of(arm, normal, center, there))
            continue
        wanted = turn(first, back, pointing)
        lacking, one, other = meet(fifth, sixth, normal, dot(normal, wanted))
        if lacking > NEAR:
            continue
        for q5 in (one, other):
            bent = turn(fifth, q5, sixth)
            flat = across(normal, bent)
            if dot(flat, flat) < NEAR:
                return 0.0
            turned = turn(normal, angle_about(normal, bent, wanted), minus(joint, center))
            least = min(least, gap_of(arm, normal, joint, plus(there, turned)))
    return least


@compiled()
def gaps_beyond(
    arm: FloatArray, wrist: bool, bases: FloatArray, poses: FloatArray, enough: float
) -> FloatArray:
    """How far poses are out of reach of an arm whose base stands in several places [m], (n,).

    Args:
        arm: The table of the arm, (ROWS, 3).
        wrist: Whether the last three axes meet.
        bases: Rotations and positions of the base in the work frame, (n, 3, 4).
        poses: Rotations and positions of the tool in the work frame, (m, 3, 4).
        enough: Poses are looked at up to one that is farther out of reach [m].

    Returns:
        The largest distance that was found at a pose; infinite where no orientation of the wrist
        will do.
    """
    found = np.empty(len(bases))
    for i in range(len(bases)):
        most = -math.inf
        for k in range(len(poses)):
            most = max(most, least_gap(arm, wrist, bases[i], poses[k]))
            if most > enough:
                break
        found[i] = most
    return found


@compiled(inner=True)
def moved_back(arm: FloatArray, base: FloatArray, pose: FloatArray, v: Vector) -> Vector:
    """The vector fixed in the last link that a pose turns to this one."""
    return turned_back(arm[BACK:END], turned_back(pose, turned_out(base, v)))


@compiled(inner=True)
def write_wrist(
    arm: FloatArray,
    base: FloatArray,
    pose: FloatArray,
    turns: Vector,
    q: FloatArray,
    count: int,
) -> int:
    """Write the joint positions of a wrist whose axes meet, behind two links; see `solve_pose`.

    Args:
        arm: As in `solve_pose`.
        base: As in `solve_pose`.
        pose: As in `solve_pose`.
        q: As in `solve_pose`.
        turns: Angles of the first joint, of the second, and from the first to the second link.
        count: How many rows are written before.
    """
    first, normal = row(arm, AXES), row(arm, AXES + 1)
    fourth, fifth, sixth = row(arm, AXES + 3), row(arm, AXES + 4), row(arm, AXES + 5)
    sense = dot(normal, row(arm, AXES + 2))
    together = turns[1] + turns[2]
    wanted = turn(first, -turns[0], moved(arm, base, pose, sixth))
    wanted = turn(normal, -together, wanted)
    held = moved_back(arm, base, pose, turn(first, turns[0], turn(normal, together, fourth)))
    lacking, one, other = meet(fifth, sixth, fourth, dot(fourth, wanted))
    if abs(lacking) <= NEAR:
        return -1
    if lacking > 0:
        return count
    for q5 in (one, other):
        q[count, 0], q[count, 1], q[count, 2] = turns[0], turns[1], sense * turns[2]
        q[count, 3] = angle_about(fourth, turn(fifth, q5, sixth), wanted)
        q[count, 4] = q5
        q[count, 5] = angle_about(sixth, held, turn(fifth, -q5, fourth))
        count += 1
    return count


@compiled(inner=True)
def write_links(
    arm: FloatArray,
    base: FloatArray,
    pose: FloatArray,
    q1: float,
    last: Vector,
    reached: Vector,
    bend: Vector,
    q: FloatArray,
    count: int,
) -> int:
    """Write the joint positions that bring the end of two links to a point; see `solve_pose`.

    Args:
        arm: As in `solve_pose`.
        base: As in `solve_pose`.
        pose: As in `solve_pose`.
        q: As in `solve_pose`.
        q1: Angle of the first joint [rad].
        last: The end of the second link, with all joints at 0.
        reached: Where it is wanted, with the first joint turned back.
        bend: Angles of joint 5, of joint 6 and of the joints 2, 3 and 4 together [rad]; the first
            is not a number for a wrist whose axes meet.
        count: How many rows are written before.
    """
    normal = row(arm, AXES + 1)
    if abs(gap_of(arm, normal, last, reached)) <= NEAR:
        return -1
    upper, fore = lengths(arm, normal, last)
    way = across(normal, minus(reached, row(arm, POINTS + 1)))
    if dot(way, way) <= NEAR:
        return -1
    cosine = (dot(way, way) - dot(upper, upper) - dot(fore, fore)) / 2
    lacking, one, other = meet(normal, fore, upper, cosine)
    if lacking > 0:
        return count
    for elbow in (one, other):
        q2 = angle_about(normal, plus(upper, turn(normal, elbow, fore)), way)
        if math.isnan(bend[0]):
            count = write_wrist(arm, base, pose, (q1, q2, elbow), q, count)
            if count < 0:
                return count
            continue
        q[count, 0], q[count, 1] = q1, q2
        q[count, 2] = dot(normal, row(arm, AXES + 2)) * elbow
        q[count, 3] = dot(normal, row(arm, AXES + 3)) * (bend[2] - q2 - elbow)
        q[count, 4], q[count, 5] = bend[0], bend[1]
        count += 1
    return count


@compiled()
def solve_pose(
    arm: FloatArray, wrist: bool, base: FloatArray, pose: FloatArray, q: FloatArray
) -> int:
    """Write all joint positions that put the tool in a pose.

    Args:
        arm: The table of the arm, (ROWS, 3).
        wrist: Whether the last three axes meet.
        base: Rotation and position of the base in the work frame, (3, 4).
        pose: Rotation and position of the tool in the work frame, (3, 4).
        q: For the joint positions [rad], (MOST, 6).

    Returns:
        How many there are; -1 where axes meet or a reach ends, so that nothing is certain.
    """
    first, normal = row(arm, AXES), row(arm, AXES + 1)
    center, foot = row(arm, CENTER), row(arm, POINTS)
    fifth, sixth, joint = row(arm, AXES + 4), row(arm, AXES + 5), row(arm, POINTS + 3)
    way = minus(center_at(arm, base, pose), foot)
    pointing = moved(arm, base, pose, sixth)
    lacking, one, other = meet(first, way, normal, dot(normal, minus(center, foot)))
    if abs(lacking) <= NEAR:
        return -1
    count = 0
    if lacking > 0:
        return count
    for back in (one, other):
        there = plus(foot, turn(first, back, way))
        if wrist:
            nothing = (math.nan, 0.0, 0.0)
            count = write_links(arm, base, pose, -back, center, there, nothing, q, count)
            if count < 0:
                return count
            continue
        wanted = turn(first, back, pointing)
        held = moved_back(arm, base, pose, turn(first, -back, normal))
        lacking, left, right = meet(fifth, sixth, normal, dot(normal, wanted))
        if lacking > NEAR:
            continue
        for q5 in (left, right):
            bent = turn(fifth, q5, sixth)
            flat = across(normal, bent)
            if dot(flat, flat) < NEAR:
                return -1
            theta = angle_about(normal, bent, wanted)
            reached = plus(there, turn(normal, theta, minus(joint, center)))
            q6 = angle_about(sixth, held, turn(fifth, -q5, normal))
            bend = (q5, q6, theta)
            count = write_links(arm, base, pose, -back, joint, reached, bend, q, count)
            if count < 0:
                return count
    return count
