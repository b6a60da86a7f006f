"""Compiled kinematics and inverse dynamics of a serial chain, for many states in one call.

A chain is a table of links, (rows, 15): rotation, row by row, and position of the frames of all
joints and of the tool, each relative to the previous frame, with z along the joint axis; then 1 if
the joint is prismatic, otherwise 0; the index of the joint whose position moves it, and the factor
of this position. The first frame is relative to the work frame. Joints that follow another joint
have rows of their own, so there may be more rows than joints and the tool.

Many states are computed in blocks, so that the processor uses vector instructions: a row of a block
holds one number of all its states.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import FUSED, compiled

Vector: TypeAlias = tuple[float, float, float]
Body: TypeAlias = tuple[float, Vector, Vector, Vector, Vector]
Rotation: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]

# Number of states per block.
B = 32
# Pi is the sum of these two parts of 33 bits [rad].
PI_HIGH = 3.1415926534682512
PI_LOW = 1.2154201012607932e-10
# Multiples of both parts of pi are exact for angles below this [rad].
EXACT_TO = 1e6
# Adding this number and subtracting it again rounds a value to a whole number.
TO_WHOLE = 6755399441055744.0
# Taylor coefficients of sin(x) / x and cos(x) as polynomials in x², the highest power first.
# Further terms are negligible for angles up to pi / 2.
SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(10, -1, -1))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(11, -1, -1))
# Number of rows per joint: cosine and sine of its position, then its first to third derivative.
JOINT_ROWS = 5
# First rows of the parts of a state; rows 0 to 8 are the columns of the rotation.
POSITION = 9
LEVER = 12  # Vector from the previous joint.
AXIS = 15
MOTION = 18  # Velocity and angular velocity, then their first and second derivatives.
# Number of rows of a state.
STATE_ROWS = 36
# Column of the table of links for kinematics that is 1 for a prismatic joint.
SLIDES = 12
# Columns of the table of links for kinematics: joint whose position moves the link, and its factor.
LEADER = 13
FACTOR = 14
# Column of the table of links for dynamics that is 1 for a prismatic joint.
DYNAMIC_SLIDES = 24
IDENTITY = (1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0)
# Number of rows of a link: cosine and sine of its joint (rows 0 and 1); first and second derivative
# of the joint (2, 3); force, and moment about the joint, for accelerations equal to the first
# derivatives without velocity (4 to 9), and for the motion with both derivatives (10 to 15); first
# moment of this and all later links (16 to 18); gravity along x and y (19, 20). A prismatic joint
# has its position in row 0, and gravity along z in row 19.
LINK_ROWS = 21
# Number of rows of the motion that is propagated from link to link, three each: angular velocity,
# velocity, angular acceleration, acceleration, gravity.
MOTION_ROWS = 15


@compiled(inner=True, fastmath=FUSED)
def write_sines(rows: FloatArray) -> None:
    """Write the cosines and sines of the joint positions [rad] in row 0 into rows 0 and 1."""
    largest = 0.0
    for i in range(B):
        largest = max(largest, abs(rows[i]))
    if not largest < EXACT_TO:
        for i in range(B):
            rows[B + i] = math.sin(rows[i])
            rows[i] = math.cos(rows[i])
        return
    for i in range(B):
        turns = (rows[i] * (1 / math.pi) + TO_WHOLE) - TO_WHOLE
        odd = turns - 2.0 * ((turns * 0.5 + TO_WHOLE) - TO_WHOLE)
        x = (rows[i] - turns * PI_HIGH) - turns * PI_LOW
        square = x * x
        sine = 0.0
        cosine = 0.0
        for term in SINE:
            sine = sine * square + term
        for term in COSINE:
            cosine = cosine * square + term
        sign = 1.0 - 2.0 * odd * odd
        rows[i] = sign * cosine
        rows[B + i] = sign * sine * x


@compiled(inner=True, fastmath=FUSED)
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(inner=True, fastmath=FUSED)
def add(a: Vector, share: float, b: Vector) -> Vector:
    """Return the sum `a + share b`."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@compiled(inner=True)
def get(rows: FloatArray, row: int, i: int) -> Vector:
    """Return the vector of state i from three rows of a block."""
    return rows[row * B + i], rows[(row + 1) * B + i], rows[(row + 2) * B + i]


@compiled(inner=True)
def put(rows: FloatArray, row: int, i: int, v: Vector) -> None:
    """Write the vector of state i into three rows of a block."""
    rows[row * B + i], rows[(row + 1) * B + i], rows[(row + 2) * B + i] = v


@compiled(inner=True)
def rotation_of(links: FloatArray, j: int) -> Rotation:
    """Return the rotation of link j relative to the previous frame, row by row."""
    x = links
    return x[j, 0], x[j, 1], x[j, 2], x[j, 3], x[j, 4], x[j, 5], x[j, 6], x[j, 7], x[j, 8]


@compiled(inner=True, fastmath=FUSED)
def into_link(r: Rotation, c: float, s: float, v: Vector) -> Vector:
    """Transform a vector from the previous frame to the axes of a link."""
    x = r[0] * v[0] + r[3] * v[1] + r[6] * v[2]
    y = r[1] * v[0] + r[4] * v[1] + r[7] * v[2]
    return c * x + s * y, c * y - s * x, r[2] * v[0] + r[5] * v[1] + r[8] * v[2]


@compiled(inner=True, fastmath=FUSED)
def out_of_link(r: Rotation, c: float, s: float, v: Vector) -> Vector:
    """Transform a vector from the axes of a link to the previous frame."""
    x = c * v[0] - s * v[1]
    y = s * v[0] + c * v[1]
    z = v[2]
    return (
        r[0] * x + r[1] * y + r[2] * z,
        r[3] * x + r[4] * y + r[5] * z,
        r[6] * x + r[7] * y + r[8] * z,
    )


@compiled(inner=True)
def write_frames(links: FloatArray, q: FloatArray, frames: FloatArray) -> None:
    """Write the frames of joints and tool in the work frame for one state.

    - `links`: (rows, 15).
    - `q`: joint positions [rad or m], (dof,).
    - `frames`: (rows, 3, 4).
    """
    for j in range(len(links)):
        moves = j < len(links) - 1
        position = links[j, FACTOR] * q[int(links[j, LEADER])] if moves else 0.0
        turns = moves and links[j, SLIDES] == 0.0
        c, s = (math.cos(position), math.sin(position)) if turns else (1.0, 0.0)
        r = rotation_of(links, j)
        p0 = links[j, 9]
        p1 = links[j, 10]
        p2 = links[j, 11]
        if links[j, SLIDES] != 0.0:
            p0, p1, p2 = add((p0, p1, p2), position, (r[2], r[5], r[8]))
        for k in range(3):
            x, y, z, origin = IDENTITY[k]
            if j > 0:
                x, y = frames[j - 1, k, 0], frames[j - 1, k, 1]
                z = frames[j - 1, k, 2]
                origin = frames[j - 1, k, 3]
            frames[j, k, 3] = origin + (x * p0 + y * p1 + z * p2)
            # A row of the rotation is a unit vector of the work frame, in components along the link
            # axes.
            frames[j, k, 0], frames[j, k, 1], frames[j, k, 2] = into_link(r, c, s, (x, y, z))


@compiled()
def frames_of(links: FloatArray, q: FloatArray) -> FloatArray:
    """Return the frames of joints and tool for many states, (n, rows, 3, 4).

    `q` are the joint positions [rad or m], (n, dof).
    """
    frames = np.empty((len(q), len(links), 3, 4))
    for i in range(len(q)):
        write_frames(links, q[i], frames[i])
    return frames


@compiled()
def jacobians(links: FloatArray, q: FloatArray) -> FloatArray:
    """Return tool velocity and angular velocity per joint velocity for many states, (n, 6, dof)."""
    n, dof = q.shape
    out = np.zeros((n, 6, dof))
    last = len(links) - 1
    frames = np.empty((last + 1, 3, 4))
    for i in range(n):
        write_frames(links, q[i], frames)
        for k in range(last):
            frame = frames[k]
            tool = frames[last]
            axis = frame[0, 2], frame[1, 2], frame[2, 2]
            lever = tool[0, 3] - frame[0, 3], tool[1, 3] - frame[1, 3], tool[2, 3] - frame[2, 3]
            move = cross(axis, lever)
            turn = axis
            if links[k, SLIDES] != 0.0:
                move = axis
                turn = (0.0, 0.0, 0.0)
            joint = int(links[k, LEADER])
            factor = links[k, FACTOR]
            for r in range(3):
                out[i, r, joint] += factor * move[r]
                out[i, 3 + r, joint] += factor * turn[r]
    return out


@compiled(inner=True, fastmath=FUSED)
def add_motion(order: int, joint: FloatArray, state: FloatArray) -> None:
    """Propagate velocities, angular velocities and their derivatives to the next frame.

    With the angular velocity w of the previous link and its derivatives e and f, a vector l of this
    link has the derivatives

        l1 = w x l,  l2 = e x l + w x l1,  l3 = f x l + 2 e x l1 + w x l2.

    The same holds for the axis of the joint, whose derivatives times those of the joint position
    are added to the angular velocity.
    """
    # The highest derivative is updated first, because it depends on the lower derivatives of the
    # previous frame.
    for i in range(B if order > 2 else 0):
        lever = get(state, LEVER, i)
        axis = get(state, AXIS, i)
        rate = joint[2 * B + i]
        w = get(state, MOTION + 3, i)
        e = get(state, MOTION + 9, i)
        f = get(state, MOTION + 15, i)
        lever1 = cross(w, lever)
        axis1 = cross(w, axis)
        lever2 = add(cross(e, lever), 1.0, cross(w, lever1))
        axis2 = add(cross(e, axis), 1.0, cross(w, axis1))
        lever3 = add(add(cross(f, lever), 2.0, cross(e, lever1)), 1.0, cross(w, lever2))
        put(state, MOTION + 12, i, add(get(state, MOTION + 12, i), 1.0, lever3))
        turned = add(add(f, joint[4 * B + i], axis), 2.0 * joint[3 * B + i], axis1)
        put(state, MOTION + 15, i, add(turned, rate, axis2))
    for i in range(B if order > 1 else 0):
        lever = get(state, LEVER, i)
        axis = get(state, AXIS, i)
        rate = joint[2 * B + i]
        w = get(state, MOTION + 3, i)
        e = get(state, MOTION + 9, i)
        lever2 = add(cross(e, lever), 1.0, cross(w, cross(w, lever)))
        put(state, MOTION + 6, i, add(get(state, MOTION + 6, i), 1.0, lever2))
        put(state, MOTION + 9, i, add(add(e, joint[3 * B + i], axis), rate, cross(w, axis)))
    for i in range(B):
        w = get(state, MOTION + 3, i)
        lever1 = cross(w, get(state, LEVER, i))
        put(state, MOTION, i, add(get(state, MOTION, i), 1.0, lever1))
        put(state, MOTION + 3, i, add(w, joint[2 * B + i], get(state, AXIS, i)))


@compiled(inner=True, fastmath=FUSED)
def add_sliding_motion(order: int, joint: FloatArray, state: FloatArray) -> None:
    """Propagate velocities and their derivatives over a prismatic joint, as `add_motion`.

    For the axis a and the derivatives r of the joint position, the lever l has the derivatives

        l1 = w x l + r1 a,  l2 = e x l + w x l1 + r2 a + r1 a1,
        l3 = f x l + 2 e x l1 + w x l2 + r3 a + 2 r2 a1 + r1 a2.

    The link does not turn.
    """
    for i in range(B):
        lever = get(state, LEVER, i)
        axis = get(state, AXIS, i)
        rate = joint[2 * B + i]
        w = get(state, MOTION + 3, i)
        e = get(state, MOTION + 9, i)
        f = get(state, MOTION + 15, i)
        axis1 = cross(w, axis)
        lever1 = add(cross(w, lever), rate, axis)
        put(state, MOTION, i, add(get(state, MOTION, i), 1.0, lever1))
        if order < 2:
            continue
        lever2 = add(cross(e, lever), 1.0, cross(w, lever1))
        lever2 = add(add(lever2, joint[3 * B + i], axis), rate, axis1)
        put(state, MOTION + 6, i, add(get(state, MOTION + 6, i), 1.0, lever2))
        if order > 2:
            lever3 = add(add(cross(f, lever), 2.0, cross(e, lever1)), 1.0, cross(w, lever2))
            lever3 = add(add(lever3, joint[4 * B + i], axis), 2.0 * joint[3 * B + i], axis1)
            axis2 = add(cross(e, axis), 1.0, cross(w, axis1))
            lever3 = add(lever3, rate, axis2)
            put(state, MOTION + 12, i, add(get(state, MOTION + 12, i), 1.0, lever3))


@compiled(inner=True, fastmath=FUSED)
def write_base(state: FloatArray) -> None:
    """Write the base, which has the unit rotation and no motion, into a block."""
    for i in range(STATE_ROWS * B):
        state[i] = 0.0
    for k in range(3):
        for i in range(B):
            state[4 * k * B + i] = 1.0


@compiled(inner=True, fastmath=FUSED)
def write_joint(
    j: int,
    factor: float,
    begin: int,
    q: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    joint: FloatArray,
) -> None:
    """Write position and derivatives of joint j, times a factor, for the block from `begin` on."""
    for i in range(B):
        # The last block is padded with the last state.
        index = min(begin + i, len(q) - 1)
        joint[i] = factor * q[index, j]
        joint[2 * B + i] = factor * first[index, j]
        joint[3 * B + i] = factor * second[index, j]
        joint[4 * B + i] = factor * third[index, j]


@compiled(inner=True, fastmath=FUSED)
def write_fixed(joint: FloatArray) -> None:
    """Write a joint that does not turn or move, such as that of the tool."""
    for i in range(JOINT_ROWS * B):
        joint[i] = 1.0 if i < B else 0.0


@compiled(inner=True, fastmath=FUSED)
def take_slide(joint: FloatArray, slide: FloatArray) -> None:
    """Move the positions of a prismatic joint into `slide`; its link does not turn."""
    for i in range(B):
        slide[i] = joint[i]
        joint[i] = 1.0
        joint[B + i] = 0.0


@compiled(inner=True, fastmath=FUSED)
def move_to_link(links: FloatArray, j: int, joint: FloatArray, state: FloatArray) -> None:
    """Replace the frames of a block by those of link j; write its lever and its joint axis."""
    r = rotation_of(links, j)
    p0 = links[j, 9]
    p1 = links[j, 10]
    p2 = links[j, 11]
    for i in range(B):
        c = joint[i]
        s = joint[B + i]
        for k in range(3):
            x = state[k * B + i]
            y = state[(3 + k) * B + i]
            z = state[(6 + k) * B + i]
            lever = x * p0 + y * p1 + z * p2
            state[(POSITION + k) * B + i] += lever
            state[(LEVER + k) * B + i] = lever
            x, y, z = into_link(r, c, s, (x, y, z))
            state[k * B + i] = x
            state[(3 + k) * B + i] = y
            state[(AXIS + k) * B + i] = state[(6 + k) * B + i] = z


@compiled(inner=True, fastmath=FUSED)
def add_slide(slide: FloatArray, state: FloatArray) -> None:
    """Add the positions of a prismatic joint along its axis to the position and the lever."""
    for k in range(3):
        for i in range(B):
            moved = slide[i] * state[(AXIS + k) * B + i]
            state[(POSITION + k) * B + i] += moved
            state[(LEVER + k) * B + i] += moved


@compiled(fastmath=FUSED)
def tool_motion(
    links: FloatArray,
    order: int,
    q: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
) -> FloatArray:
    """Return tool poses, or derivatives of the tool's motion up to an order, for many states.

    The motion is propagated from the base to the tool, link by link (Featherstone, Rigid Body
    Dynamics Algorithms, 2008, 5.3), with the formulas of `add_motion` and `add_sliding_motion`.

    Returns for order 0 rotation and position, (3, 4) row by row, (n, 12); otherwise velocity and
    angular velocity, then their derivatives, (n, 6 order).

    - `links`: (rows, 15).
    - `q`: joint positions [rad or m], (n, dof).
    - `first`, `second`, `third`: their derivatives, (n, dof) each; only those up to `order` are
      used.
    """
    n = len(q)
    last = len(links) - 1
    result = np.empty((n, 6 * order if order else 12))
    joint = np.empty(JOINT_ROWS * B)
    state = np.empty(STATE_ROWS * B)
    slide = np.empty(B)
    for begin in range(0, n, B):
        write_base(state)
        for j in range(last + 1):
            # Joint of the link
            slides = links[j, SLIDES] != 0.0
            if j == last:
                write_fixed(joint)
            else:
                leader = int(links[j, LEADER])
                write_joint(leader, links[j, FACTOR], begin, q, first, second, third, joint)
            if slides:
                take_slide(joint, slide)
            elif j < last:
                write_sines(joint)
            # Frame of the link
            move_to_link(links, j, joint, state)
            if slides:
                add_slide(slide, state)
            # Motion of the link
            if order > 0 and slides:
                add_sliding_motion(order, joint, state)
            elif order > 0:
                add_motion(order, joint, state)
        # Results of the states of the block, without the padding
        for i in range(min(B, n - begin)):
            for k in range(result.shape[1]):
                row = MOTION + k if order else 3 * (k % 4) + k // 4
                result[begin + i, k] = state[row * B + i]
    return result


# Inverse dynamics: the recursive Newton-Euler algorithm (Featherstone, Rigid Body Dynamics
# Algorithms, 2008, 5.3) in the frames of the links, whose z axes are the joint axes.
@compiled(inner=True, fastmath=FUSED)
def put_wrenches(
    body: Body, w: Vector, v: Vector, e: Vector, a: Vector, rows: FloatArray, i: int
) -> None:
    """Write the wrenches of a link for its motion at the origin of its joint."""
    # Wrenches: mass times acceleration, and inertia about the joint times angular acceleration.
    mass, h, i0, i1, i2 = body
    put(rows, 16, i, h)
    u = cross(w, h)
    spin = add(add(add((0.0, 0.0, 0.0), w[0], i0), w[1], i1), w[2], i2)
    put(rows, 4, i, add(u, mass, v))
    put(rows, 7, i, add(spin, 1.0, cross(h, v)))
    put(rows, 10, i, add(add(cross(e, h), 1.0, cross(w, u)), mass, a))
    turned = add(add(add(cross(w, spin), e[0], i0), e[1], i1), e[2], i2)
    put(rows, 13, i, add(turned, 1.0, cross(h, a)))


@compiled(inner=True)
def body_of(links: FloatArray, j: int) -> Body:
    """Return mass, first moment and inertia columns of link j about its joint."""
    x = links
    return (
        x[j, 12],
        (x[j, 13], x[j, 14], x[j, 15]),
        (x[j, 16], x[j, 17], x[j, 18]),
        (x[j, 17], x[j, 19], x[j, 20]),
        (x[j, 18], x[j, 20], x[j, 21]),
    )


@compiled(inner=True, fastmath=FUSED)
def propagate_outward(links: FloatArray, j: int, motion: FloatArray, rows: FloatArray) -> None:
    """Propagate the motion of a block to link j, and write the wrenches of the link."""
    r = rotation_of(links, j)
    body = body_of(links, j)
    p = links[j, 9], links[j, 10], links[j, 11]
    for i in range(B):
        c = rows[i]
        s = rows[B + i]
        rate = rows[2 * B + i]
        second = rows[3 * B + i]
        # Motion of the origin of the joint, in the axes of the previous link.
        w = get(motion, 0, i)
        e = get(motion, 6, i)
        turned = cross(w, p)
        v = add(get(motion, 3, i), 1.0, turned)
        a = add(add(get(motion, 9, i), 1.0, cross(e, p)), 1.0, cross(w, turned))
        w = into_link(r, c, s, w)
        w = w[0], w[1], w[2] + rate
        e = into_link(r, c, s, e)
        e = e[0] + w[1] * rate, e[1] - w[0] * rate, e[2] + second
        v = into_link(r, c, s, v)
        a = into_link(r, c, s, a)
        g = into_link(r, c, s, get(motion, 12, i))
        put(motion, 0, i, w)
        put(motion, 3, i, v)
        put(motion, 6, i, e)
        put(motion, 9, i, a)
        put(motion, 12, i, g)
        rows[19 * B + i] = g[0]
        rows[20 * B + i] = g[1]
        put_wrenches(body, w, v, e, a, rows, i)


@compiled(inner=True, fastmath=FUSED)
def propagate_sliding(links: FloatArray, j: int, motion: FloatArray, rows: FloatArray) -> None:
    """Propagate the motion over a prismatic joint, which does not turn its link.

    The arguments are those of `propagate_outward`.
    """
    r = rotation_of(links, j)
    body = body_of(links, j)
    start = (links[j, 9], links[j, 10], links[j, 11])
    along = (r[2], r[5], r[8])
    for i in range(B):
        slide = rows[i]
        rate = rows[2 * B + i]
        second = rows[3 * B + i]
        p = add(start, slide, along)
        w = get(motion, 0, i)
        e = get(motion, 6, i)
        turned = cross(w, p)
        v = add(get(motion, 3, i), 1.0, turned)
        a = add(add(get(motion, 9, i), 1.0, cross(e, p)), 1.0, cross(w, turned))
        w = into_link(r, 1.0, 0.0, w)
        e = into_link(r, 1.0, 0.0, e)
        v = into_link(r, 1.0, 0.0, v)
        a = into_link(r, 1.0, 0.0, a)
        g = into_link(r, 1.0, 0.0, get(motion, 12, i))
        v = v[0], v[1], v[2] + rate
        # The Coriolis acceleration is 2 w x (rate z).
        a = a[0] + 2.0 * w[1] * rate, a[1] - 2.0 * w[0] * rate, a[2] + second
        put(motion, 0, i, w)
        put(motion, 3, i, v)
        put(motion, 6, i, e)
        put(motion, 9, i, a)
        put(motion, 12, i, g)
        rows[19 * B + i] = g[2]
        put_wrenches(body, w, v, e, a, rows, i)


@compiled(inner=True, fastmath=FUSED)
def accumulate_inward(links: FloatArray, j: int, rows: FloatArray, before: FloatArray) -> None:
    """Add the wrenches and the first moment of a link to those of the previous link."""
    r = rotation_of(links, j)
    carried = links[j, 22]
    p = links[j, 9], links[j, 10], links[j, 11]
    for i in range(B):
        c = rows[i]
        s = rows[B + i]
        for k in range(4, 16, 6):
            force = out_of_link(r, c, s, get(rows, k, i))
            put(before, k, i, add(get(before, k, i), 1.0, force))
            turned = add(out_of_link(r, c, s, get(rows, k + 3, i)), 1.0, cross(p, force))
            put(before, k + 3, i, add(get(before, k + 3, i), 1.0, turned))
        moved = add(out_of_link(r, c, s, get(rows, 16, i)), carried, p)
        put(before, 16, i, add(get(before, 16, i), 1.0, moved))


@compiled(inner=True, fastmath=FUSED)
def accumulate_sliding(links: FloatArray, j: int, rows: FloatArray, before: FloatArray) -> None:
    """Add the wrenches and the first moment of a link after a prismatic joint.

    The arguments are those of `accumulate_inward`.
    """
    r = rotation_of(links, j)
    carried = links[j, 22]
    start = (links[j, 9], links[j, 10], links[j, 11])
    along = (r[2], r[5], r[8])
    for i in range(B):
        p = add(start, rows[i], along)
        for k in range(4, 16, 6):
            force = out_of_link(r, 1.0, 0.0, get(rows, k, i))
            put(before, k, i, add(get(before, k, i), 1.0, force))
            turned = add(out_of_link(r, 1.0, 0.0, get(rows, k + 3, i)), 1.0, cross(p, force))
            put(before, k + 3, i, add(get(before, k + 3, i), 1.0, turned))
        moved = add(out_of_link(r, 1.0, 0.0, get(rows, 16, i)), carried, p)
        put(before, 16, i, add(get(before, 16, i), 1.0, moved))


@compiled(fastmath=FUSED)
def path_terms(
    links: FloatArray, gravity: FloatArray, q: FloatArray, first: FloatArray, second: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the coefficients a, b, c of the torque `a dds + b ds² + c`, (n, dof) each.

    - `links`: (dof, 25).
    - `gravity`: gravitational acceleration [m/s²], (3,).
    - `q`: joint positions [rad or m], (n, dof).
    - `first`, `second`: their first and second derivative by s, (n, dof) each.
    """
    n, dof = q.shape
    a = np.empty((n, dof))
    b = np.empty((n, dof))
    c = np.empty((n, dof))
    rows = np.empty((dof, LINK_ROWS * B))
    motion = np.empty(MOTION_ROWS * B)
    for begin in range(0, n, B):
        for j in range(dof):
            link_rows = rows[j]
            for i in range(B):
                # The last block is padded with the last state.
                state = min(begin + i, n - 1)
                link_rows[i] = q[state, j]
                link_rows[2 * B + i] = first[state, j]
                link_rows[3 * B + i] = second[state, j]
        for m in range(MOTION_ROWS * B):
            motion[m] = gravity[m // B - 12] if m >= 12 * B else 0.0
        for j in range(dof):
            if links[j, DYNAMIC_SLIDES] != 0.0:
                propagate_sliding(links, j, motion, rows[j])
            else:
                write_sines(rows[j])
                propagate_outward(links, j, motion, rows[j])
        for j in range(dof - 1, 0, -1):
            if links[j, DYNAMIC_SLIDES] != 0.0:
                accumulate_sliding(links, j, rows[j], rows[j - 1])
            else:
                accumulate_inward(links, j, rows[j], rows[j - 1])
        for j in range(dof):
            link_rows = rows[j]
            armature = links[j, 23]
            if links[j, DYNAMIC_SLIDES] != 0.0:
                for i in range(min(B, n - begin)):
                    state = begin + i
                    # Forces along the joint axis.
                    a[state, j] = link_rows[6 * B + i] + armature * first[state, j]
                    b[state, j] = link_rows[12 * B + i] + armature * second[state, j]
                    c[state, j] = -links[j, 22] * link_rows[19 * B + i]
                continue
            for i in range(min(B, n - begin)):
                state = begin + i
                # Moments about the joint axis.
                a[state, j] = link_rows[9 * B + i] + armature * first[state, j]
                b[state, j] = link_rows[15 * B + i] + armature * second[state, j]
                c[state, j] = (
                    link_rows[17 * B + i] * link_rows[19 * B + i]
                    - link_rows[16 * B + i] * link_rows[20 * B + i]
                )
    return a, b, c
