"""Inverse kinematics and path derivatives at 2,000 places, against pinocchio's forward kinematics.

The UR5e follows the rounded square, once with a constant tool orientation and once with another
one at every corner. Our side does what tracing does at its knots: poses and rates of the path,
Newton's method for the joint positions, dq_ds and d2q_ds2. The peer calls
`pin.framesForwardKinematics` once per place from a Python loop, on a model with 18 frames, which is
fewer than a description with meshes has.

Newton's method starts from a guess. Tracing guesses a knot from a quintic through its neighbours.
Here all places are guessed from quintics through the first knots, which are the farthest apart in
tracing. Two more lines have worse guesses than tracing: the joint positions of the previous place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from armcontour.motion import quintic
from armcontour.planning.tracing.knots import Knots, first_knots, motion_at
from armcontour.planning.tracing.tracer import NumericSolver
from benchmarks import ur5e
from benchmarks.measured import Bar, Line, Pair, timed

PLACES = 2000
# Paths and guesses, by the parts of the lines' names.
PATHS = {"held": "one orientation", "turning": "turning"}
GUESSES = {"quintics": "quintics", "place": "the place before"}
TURN = 0.3  # rad, between corners of the second path
ANGULAR_TOLERANCE = 0.02  # rad
# Tolerance of the tool's position [m].
TOOL = 1e-10
# Tolerance of the tool's rotation matrix per element, which for small angles is in rad.
TURNED = 1e-10
# Tolerance of the tool pose's derivatives over arc length, as a share of the largest plus 1.
DERIVATIVES = 1e-8


@dataclass(frozen=True)
class Task:
    """Places of a path: intervals that begin there, guesses, and what finds the rest."""

    solver: NumericSolver
    knots: Knots
    guesses: dict[str, FloatArray]
    path: ac.Path


def lines() -> list[Line]:
    """Return the lines for both paths from all guesses, and for the path's part of it."""
    peer = f"{PLACES:,} forward kinematics, pinocchio"
    entries = []
    for key, name in PATHS.items():
        for start, guessed in GUESSES.items():
            title = f"IK and derivatives, {name}, from {guessed}"
            entries.append(
                Line(f"ik/{key}/{start}", title, peer, partial(_pair, key, start), Bar(ratio=10))
            )
        title = f"of it, poses and rates of the path, {name}"
        entries.append(Line(f"ik/{key}/path", title, peer, partial(_pair, key, None)))
    return entries


def _pair(key: str, start: str | None) -> Pair:
    import pinocchio as pin

    arm = ur5e.load()
    path = path_of(key)
    model = pin.buildModelFromXML(ur5e.urdf(arm, 1.0))
    data = model.createData()
    task = prepared(arm, path)
    exact = task.solver.ends(task.knots, task.knots.u0, task.guesses["quintics"])[0]

    def peer() -> None:
        for row in exact:
            pin.framesForwardKinematics(model, data, row)

    if start is None:
        return Pair(timed(partial(_evaluate, task)), timed(peer))
    guess = task.guesses[start]
    error, moved = verified(arm, model, task, guess)
    note = f"guesses off by {np.median(moved):.1e} rad, at most {moved.max():.1e}"
    ours = timed(partial(task.solver.ends, task.knots, task.knots.u0, guess))
    return Pair(ours, timed(peer), lambda: [f"{note}; tool within {error:.1e} m"])


def path_of(key: str) -> ac.Path:
    """Make the square with its tool held in one way, or in a way at every corner."""
    error = ur5e.CORNER_ERROR
    if key == "held":
        return ac.round_corners(ur5e.square(), tolerance=error)
    from scipy.spatial.transform import Rotation

    turns = TURN * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1], [0, 0, 0]])
    turned = Rotation.from_rotvec(turns).as_matrix() @ ur5e.DOWN
    return ac.round_corners(
        ur5e.square(turned), tolerance=error, angular_tolerance=ANGULAR_TOLERANCE
    )


def prepared(arm: ac.SerialArm, path: ac.Path) -> Task:
    """Return places at even arc lengths, and guesses for them."""
    assert path.orientation is not None
    s = path.length * (np.arange(PLACES) + 0.5) / PLACES
    segment = path.locate(s)
    u = s - path.breaks[segment]
    knots = Knots(segment=segment, piece=path.orientation.locate(s), u0=u, u1=u, s0=s)
    first = first_knots(path, arm.span)
    traced = ac.trace(path, arm)
    q = traced(np.append(first.s0, path.length))
    solver = NumericSolver(path, arm, 6, 1e-10, None)
    begin, end = solver.first_ends(first, np.concatenate([q[:-1], q[1:]]))
    coefficients = quintic(first.u1 - first.u0, begin, end)
    i = np.clip(np.searchsorted(first.s0, s, side="right") - 1, 0, len(first) - 1)
    x = (s - first.s0[i]) / (first.u1 - first.u0)[i]
    quintics = np.einsum("ikj,ik->ij", coefficients[i], x[:, None] ** np.arange(6))
    guesses = {"quintics": quintics, "place": traced(np.append(0.0, s[:-1]))}
    return Task(solver, knots, guesses, path)


def verified(
    arm: ac.SerialArm, model: object, task: Task, guess: FloatArray
) -> tuple[float, FloatArray]:
    """Return the tool's distance from the path by pinocchio [m], and the guesses' errors [rad].

    Raises:
        AssertionError: Something is not right.
    """
    import pinocchio as pin

    knots = task.knots
    q, dq_ds, d2q_ds2 = task.solver.ends(knots, knots.u0, guess)
    poses, rates = _evaluate(task)
    data = model.createData()
    frame = model.getFrameId(ur5e.TOOL)
    places = np.empty((PLACES, 3, 4))
    for k, row in enumerate(q):
        pin.framesForwardKinematics(model, data, row)
        places[k] = data.oMf[frame].homogeneous[:3]
    error = float(np.linalg.norm(places[:, :, 3] - poses[:, :, 3], axis=1).max())
    turned = float(np.abs(places[:, :, :3] - poses[:, :, :3]).max())
    first = arm.tool_twist(q, dq_ds) - rates[:, [0, 2]].reshape(PLACES, 6)
    second = arm.tool_twist_rate(q, dq_ds, d2q_ds2) - rates[:, [1, 3]].reshape(PLACES, 6)
    wrong = max(float(np.abs(x).max() / (1 + np.abs(rates).max())) for x in (first, second))
    if error > TOOL or turned > TURNED or wrong > DERIVATIVES:
        raise AssertionError(f"Not right: {error:.1e} m, {turned:.1e} rad, rates {wrong:.1e}.")
    return error, np.abs(q - guess).max(axis=1)


def _evaluate(task: Task) -> tuple[FloatArray, FloatArray]:
    knots = task.knots
    return motion_at(task.path, knots, knots.u0)
