"""Rigid-body robots of a box, executed by MuJoCo: worst corners, and robots drawn from the box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.progress import Step
from armcontour.geometry import Path
from armcontour.motion import Execution, SetPoints
from armcontour.simulation import RigidBodyPlant, simulate
from armcontour.simulation.robustness.monte_carlo import MonteCarloResult
from armcontour.simulation.robustness.rigid_body_runs import (
    BodyRuns,
    spread_on_bodies,
    trace_on_bodies,
)
from armcontour.simulation.robustness.uncertainty import Uncertainty, Unknowns
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.limit_margins import across_directions

# Number of corners that trials execute (the worst corners for the first plan), and number of robots
# that a failed proof adds to the trials.
FIRST_CORNERS, ADDED_ROBOTS = 2, 4
# Largest number of unknowns for which all corners are listed.
ALL_CORNERS = 14


def worst_corners(case: Case, set_points: SetPoints) -> tuple[FloatArray, dict[str, float]]:
    """Corners of the box, the worst first, (m, k), and parts of the worst error by kind [m].

    One robot per unknown is executed. The sum of their deviations, which is exact to first order,
    determines the worst corner at each time and for each direction across the path. The keys of the
    parts are the kinds of unknowns, and "sampling" for the nominal robot.
    """
    runs = _runs(case, set_points)
    unknowns = runs.unknowns
    k = len(unknowns)
    if not k:
        return np.zeros((1, 0)), {}
    low, high = unknowns.low, unknowns.high
    single = np.where(high >= -low, high, low)
    alone = np.concatenate([np.zeros((1, k)), np.diag(single)])
    traces = trace_on_bodies(runs, alone, executor=case.executor)
    n = min(len(tool) for _, _, tool in traces)
    nominal = traces[0][2][:n]
    s = runs.path.project(nominal).s
    deviation, tangent = nominal - runs.path(s), runs.path(s, 1)
    each = np.array([tool[:n] - nominal for _, _, tool in traces[1:]]).reshape(k, n, -1)
    each = np.moveaxis(each, 0, 2) / single
    middle, half = (high + low) / 2, (high - low) / 2
    # Beyond an end of the path, the nearest point of the path is the end.
    ends = []
    for end, sign in ((0.0, -1.0), (runs.path.length, 1.0)):
        outward = np.tile(sign * runs.path(end, 1), (n, 1))
        reach = np.abs(np.einsum("ndk,nd->nk", each, outward) * np.abs(single)).sum(axis=1)
        beyond = np.einsum("nd,nd->n", nominal - runs.path(end), outward)
        ends.append((np.where(abs(s - end) <= reach, beyond, -np.inf), outward))
    bound, errors = np.zeros(0), np.zeros((0, k))
    largest, parts = -np.inf, {}
    for nominal_part, side in [
        (np.einsum("nd,nd->n", deviation, x), x) for x in across_directions(tangent)
    ] + ends:
        moved = np.einsum("ndk,nd->nk", each, side)
        corner = middle + np.where(moved >= 0, half, -half)
        total = nominal_part + (moved * corner).sum(axis=1)
        bound, errors = np.append(bound, total), np.concatenate([errors, corner])
        i = int(np.argmax(total))
        if total[i] > largest:
            largest, parts = float(total[i]), {"sampling": float(nominal_part[i])}
            for kind, part in zip(unknowns.kinds, (moved * corner)[i].tolist(), strict=True):
                parts[kind] = parts.get(kind, 0.0) + part
    unique, where = np.unique(errors, axis=0, return_inverse=True)
    worst = np.full(len(unique), -np.inf)
    np.maximum.at(worst, where.ravel(), bound)
    unique = unique[np.argsort(-worst, kind="stable")]
    return _more_corners(unknowns, unique, case.goal.corners), parts


def _more_corners(unknowns: Unknowns, first: FloatArray, count: int) -> FloatArray:
    """The first corners, followed by other corners, up to `count` corners in total, (m, k)."""
    if len(first) >= count:
        return first[:count]
    if len(unknowns) <= ALL_CORNERS:
        others = unknowns.corners()
    else:
        # The other corners differ from the first corners in one unknown.
        flipped = np.where(np.eye(len(unknowns), dtype=np.bool_), -1.0, 1.0)
        middle = (unknowns.low + unknowns.high) / 2
        others = (middle + (first - middle)[:, None] * flipped).reshape(-1, len(unknowns))
    both = np.concatenate([first, others])
    _, index = np.unique(both, axis=0, return_index=True)
    return np.asarray(both[np.sort(index)][:count])


def largest_errors(case: Case, set_points: SetPoints, errors: list[FloatArray]) -> FloatArray:
    """Times [s] and the largest contour error at each time of robots with `errors` [m], (2, n)."""
    runs = _runs(case, set_points)
    traces = trace_on_bodies(runs, np.array(errors), executor=case.executor)
    t = max((x[0] for x in traces), key=len)
    largest = np.zeros(len(t))
    for times, distances, _ in traces:
        largest[: len(times)] = np.maximum(largest[: len(times)], distances)
    return np.stack([t, largest])


def execute_bodies(
    case: Case, set_points: SetPoints, errors: FloatArray, seed: int | None = None
) -> MonteCarloResult:
    """Execute set-points on robots with errors (n, k); `seed`: None for corners of the box."""
    kind = "corners of the box" if seed is None else "robots of the box"
    names = (f"{len(errors)} {kind} as rigid bodies",)

    def report(done: int) -> None:
        case.progress(Step(names, done / (len(errors) + 1)))

    runs = _runs(case, set_points)
    return spread_on_bodies(runs, errors, seed=seed, executor=case.executor, done=report)


def draw_robots(case: Case) -> FloatArray:
    """Errors of the unknowns of robots drawn from the box, (n, k)."""
    return _unknowns(case).draw(case.goal.bodies, case.goal.seed)


def torque_ratio(case: Case, executed: Execution) -> float:
    """Largest ratio of a required drive torque to its limit."""
    plant = case.plant()
    assert isinstance(plant, RigidBodyPlant) and executed.torque_demand is not None
    return float(np.max(np.abs(executed.torque_demand) / plant.torque_limit))


def rest_at_start(case: Case, path: Path, set_points: SetPoints) -> float:
    """Distance from the tool at rest to the start of its path [m].

    Raises ExecutionError if the drives cannot hold the robot at rest.
    """
    standing = replace(set_points, q=np.tile(set_points.q[0], (2, 1)))
    executed = simulate(standing, case.plant(), resolution=case.resolution)
    return float(np.linalg.norm(executed.tool[0] - path(0.0)))


def _unknowns(case: Case) -> Unknowns:
    return Unknowns.from_uncertainty(case.box or Uncertainty(), case.arm, case.servo)


def _runs(case: Case, set_points: SetPoints) -> BodyRuns:
    (contour,) = case.program.contours
    return BodyRuns(
        set_points=set_points,
        path=contour.path,
        unknowns=_unknowns(case),
        limits=case.limits,
        options=case.drive_options,
    )
