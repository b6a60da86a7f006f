"""`judge`: verdict on an attempt from executions on the robot and on robots of the box.

The judge shares no estimate with the search, which only proposes attempts (`search.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.pool import map_in_threads
from armcontour.core.progress import Step
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.geometry import ShapedPath
from armcontour.motion import Execution, JointPath, PathLaw, SetPoints, Trajectory, largest_shares
from armcontour.robot import Arm, Limits
from armcontour.robot.servo import ServoModel
from armcontour.simulation import simulate
from armcontour.studies.certification.case import RESOLUTION, Attempt, Case
from armcontour.verification import Check, check
from armcontour.verification.contour_errors import ContourExecution, pieces_of

# A limit is exceeded by a ratio above 1 + LIMIT_TOLERANCE, to allow for rounding errors.
LIMIT_TOLERANCE = 1e-9
# Number of points per interval at which a plan is checked against its limits.
CHECK_POINTS = 5
# Share by which the executed tool speed may exceed the assigned velocity.
SPEED_SLACK = 1e-3
# Parameters of a servo that are uncertain.
PARAMETERS = ("kp", "kv", "dead time")
# Largest number of corners that are executed, and number of robots drawn from the box with the seed
# SEED.
MAX_CORNERS, DRAWN, SEED = 256, 100, 0
# Time between two results of an execution [s]; peaks between them are evaluated.
RESULT_STEP = 2e-3
# Largest number of parameters of the worst robot in a summary.
MAX_NAMED = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoxErrors(Result):
    """Contour errors of one contour on the executed robots of a box.

    Args:
        max: Largest contour error of each robot, of both directions [m], (n,).
        names: Names of the uncertain parameters.
        deviations: Errors of these parameters (relative, or in s), (n, len(names)).
        robots: Errors of all parameters of the robots, (n, 3 dof), as for `servo_with`.
        demand: Largest ratio of a commanded acceleration to its limit on each robot, (n,).
    """

    max: FloatArray
    names: tuple[str, ...]
    deviations: FloatArray
    robots: FloatArray
    demand: FloatArray

    def to_data(self) -> Data:
        """Data of the largest error, and of the parameters of the worst robot."""
        errors = self.deviations[int(np.argmax(self.max))].tolist()
        worst = dict(zip(self.names, errors, strict=True))
        largest = sorted(worst, key=lambda x: -abs(worst[x]))[:MAX_NAMED]
        robot = ", ".join(f"{x} {worst[x]:+.3g}" for x in largest)
        return Data(
            f"{len(self.max)} robots of the box",
            (
                Row("executions", len(self.max)),
                Row("max", self.max.max(), "m", "contour error, largest", robot, VERDICT),
                Row("worst", worst),
            ),
        )

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """The verdict on an attempt, with its evidence."""

    case: Case
    attempt: Attempt
    executed: Execution  # Execution on the nominal robot
    pieces: Sequence[ContourExecution]  # Parts of this execution, one per contour
    check: Check  # Check of the plan against all limits
    robots: Sequence[BoxErrors]  # Contour errors on robots of the box, one per contour; may be ()
    # ratios: largest ratios of the execution of each contour by cause of derating.
    ratios: Sequence[dict[str, float]]

    @property
    def kept(self) -> bool:
        """True if the plan and its executions satisfy all limits and the goal."""
        return all(x <= 1.0 for each in self.ratios for x in each.values())

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.attempt.trajectory.duration

    @property
    def largest_error(self) -> float:
        """Largest contour error on all executed robots [m]."""
        errors = [max(x.contour_error.max, x.coverage_error.max) for x in self.pieces]
        return max(errors + [float(x.max.max()) for x in self.robots])


def judge(case: Case, attempt: Attempt) -> Verdict:
    """Execute an attempt, and compare it with all limits and with the goal."""
    executed = simulate(attempt.set_points, case.plant(), resolution=RESOLUTION)
    pieces = pieces_of(executed, case.program, None, None)
    checked = check(attempt.trajectory, case.arm, case.limits, points=CHECK_POINTS)
    # Values of the whole program count for each contour.
    limits = [case.command_ratios(attempt.set_points).max(), *(x.ratio for x in checked.uses)]
    for move in attempt.moves:
        bounds = bound_ratios(move.plan, case.arm, move.limits)
        # Assigned speeds of a path do not restrict a rapid.
        names = bounds if move.number is not None else ("joint_acceleration", "joint_velocity")
        limits += [bounds[name] for name in names]
    robots = execute_box(case, attempt.set_points)
    demands = [case.demand_ratio(executed.demand_range).max(), *(x.demand.max() for x in robots)]
    whole = {"acceleration": max(demands), "speed": max(limits)}
    whole = {cause: float(ratio) / (1 + LIMIT_TOLERANCE) for cause, ratio in whole.items()}
    ratios = [
        {**whole, **_contour_ratios(case, attempt, piece, k)} for k, piece in enumerate(pieces)
    ]
    for each, errors in zip(ratios, robots, strict=False):
        each["box"] = float(errors.max.max()) / case.budget
    return Verdict(
        case=case,
        attempt=attempt,
        executed=executed,
        pieces=pieces,
        check=checked,
        robots=robots,
        ratios=ratios,
    )


def _contour_ratios(
    case: Case, attempt: Attempt, piece: ContourExecution, number: int
) -> dict[str, float]:
    """Ratios of tool speed and contour error in the execution of a contour, by cause."""
    tool = float(piece.speed_ratios(case.limits.speed, between=True).max())
    if case.limits.speed is not None:
        executed, during = piece.executed, slice(None)
        if case.program.single_path is None:
            during = slice(*np.searchsorted(executed.t, attempt.trajectory.contour_spans[number].t))
        moved = case.arm.tool_velocity(executed.q[during], executed.dq[during])
        tool = max(tool, float(np.linalg.norm(moved, axis=1).max()) / case.limits.speed)
    error = max(piece.contour_error.max, piece.coverage_error.max) / case.budget
    if case.goal.rms is not None:
        error = max(error, piece.contour_error.rms / case.goal.rms)
    # Ratios of "tool" are those of squared speeds.
    return {"tool": (tool / (1 + SPEED_SLACK)) ** 2, "error": error, "box": 0.0}


def execute_box(case: Case, set_points: SetPoints) -> list[BoxErrors]:
    """Execute a program on robots of the box; returns the errors of each contour, [] without a box.

    If k parameters are uncertain, all 2^k corners of the box are executed, or if these are more
    than MAX_CORNERS, corners that a search finds. DRAWN more robots are drawn from the box, because
    the worst robot need not be in a corner.
    """
    if case.goal.box is None:
        return []
    case.progress(Step(("robots of the box",)))
    half_widths = case.goal.box.half_widths(case.servo, case.arm.dof)
    varies, shared = half_widths > 0, case.goal.box.dead_time_shared
    if shared:
        varies[2, 1:] = False

    def deviations(unit: FloatArray) -> FloatArray:
        """Errors of all parameters of robots in units of the box, (n, 3 dof)."""
        rows = np.zeros((len(unit), *half_widths.shape))
        rows[:, varies] = unit
        if shared:
            rows[:, 2] = rows[:, 2, :1]
        return (rows * half_widths).reshape(len(unit), -1)

    def errors(unit: FloatArray) -> FloatArray:
        """Largest contour errors and demand of robots in units of the box, (n, contours + 1)."""
        robots = list(deviations(unit))
        return np.array(map_in_threads(partial(_execute_robot, case, set_points), robots))

    k = int(varies.sum())
    if 2**k <= MAX_CORNERS:
        corners = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, -1.0, 1.0)
        found = errors(corners)
    else:
        corners, found = _search_corners(errors, k)
    drawn = np.random.default_rng(SEED).uniform(-1, 1, size=(DRAWN, k))
    names = np.array([[f"{x} of joint {j + 1}" for j in range(case.arm.dof)] for x in PARAMETERS])
    if shared:
        names[2] = "dead time"
    robots = deviations(np.concatenate([corners, drawn]))
    *contours, demand = np.concatenate([found, errors(drawn)]).T
    kept, named = robots[:, varies.ravel()], tuple(names[varies].tolist())
    return [
        BoxErrors(max=x, names=named, deviations=kept, robots=robots, demand=demand)
        for x in contours
    ]


def joint_corners(case: Case) -> list[FloatArray]:
    """Errors of robots in the corners of the box in which all joints have the same ends.

    Because joints are independent, these robots have the largest demands of each joint.
    """
    if case.goal.box is None:
        return []
    half_widths = case.goal.box.half_widths(case.servo, case.arm.dof)
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    return list(np.unique((signs[:, :, None] * half_widths).reshape(len(signs), -1), axis=0))


def servo_with(servo: ServoModel, deviations: FloatArray) -> ServoModel:
    """The servo with errors of kp, kv (relative) and dead time [s], (3, dof) or (3 dof,)."""
    kp, kv, dead_time = deviations.reshape(3, -1)
    return servo.replace(
        kp=servo.kp * (1 + kp),
        kv=None if servo.kv is None else servo.kv * (1 + kv),
        dead_time=np.maximum(servo.dead_time + dead_time, 0.0),
    )


def _execute_robot(case: Case, set_points: SetPoints, deviations: FloatArray) -> list[float]:
    """Largest error of each contour on a robot, of both directions [m], and its demand."""
    plant = case.plant(servo_with(case.servo, deviations))
    resolution = min(RESULT_STEP, set_points.cycle)
    executed = simulate(set_points, plant, resolution=resolution)
    pieces = pieces_of(executed, case.program, None, None)
    demand = float(case.demand_ratio(executed.demand_range).max())
    return [*(max(x.contour_error.max, x.coverage_error.max) for x in pieces), demand]


def _search_corners(
    errors: Callable[[FloatArray], FloatArray], k: int
) -> tuple[FloatArray, FloatArray]:
    """Signs of the corners to execute if the box has more than MAX_CORNERS, and their errors.

    First the corner with the worse sign of each single parameter, then the corners of a search from
    there that changes one sign per step while the error increases, then random corners.

    `errors` maps signs, (n, k), to errors [m] and demand, (n, contours + 1).
    """
    single = errors(np.concatenate([np.eye(k), -np.eye(k)]))[:, :-1].max(axis=1)
    best = np.where(single[:k] >= single[k:], 1.0, -1.0)
    corners = np.stack([best, -best])
    found = errors(corners)
    worst = found[0, :-1].max()
    while len(corners) + k <= MAX_CORNERS:
        neighbours = np.where(np.eye(k, dtype=np.bool_), -best, best)
        tried = errors(neighbours)
        corners, found = np.concatenate([corners, neighbours]), np.concatenate([found, tried])
        largest = tried[:, :-1].max(axis=1)
        i = int(np.argmax(largest))
        if largest[i] <= worst:
            break
        best, worst = neighbours[i], largest[i]
    random = np.random.default_rng(SEED).choice([-1.0, 1.0], size=(MAX_CORNERS - len(corners), k))
    return np.concatenate([corners, random]), np.concatenate([found, errors(random)])


def bound_ratios(plan: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Upper bounds of a plan's ratios to limits of acceleration and speed, valid at all times."""
    joints = np.stack([*limits.acceleration_bounds(arm.dof), *limits.velocity_bounds(arm.dof)])
    shares = np.zeros(6)
    for law in plan.laws:
        assert isinstance(law, PathLaw)
        speeds = _highest_speeds(law.joint_path, limits)
        shares = np.maximum(shares, largest_shares(law, joints, speeds, 1 + LIMIT_TOLERANCE))
    acceleration, velocity = shares[:4].reshape(2, 2).max(axis=1).tolist()
    speed, bent = shares[4:].tolist()
    return {
        "joint_acceleration": acceleration,
        "joint_velocity": velocity,
        "speed": speed,
        "centripetal_acceleration": bent**2,
    }


def _highest_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Path speeds that the limits of speed and centripetal acceleration allow [m/s], (pieces, 2).

    The second column is infinite for segments with varying curvature, which the check samples.
    """
    breaks, path = joint_path.breaks, joint_path.tool_path
    bounds = np.full((len(breaks) - 1, 2), np.inf)
    if path is None:
        return bounds
    # Breaks of the tool path are breaks of the joint path.
    segment = path.locate((breaks[:-1] + breaks[1:]) / 2)
    bounds[:, 0] = path.assigned_speeds(limits.speed)[segment]
    varies = path.segments.is_transition[segment] | (
        isinstance(path, ShapedPath) and path.curve is not None
    )
    if limits.centripetal_acceleration is not None:
        bent = np.where(varies, 0.0, np.abs(path.curvatures[segment]))
        with np.errstate(divide="ignore"):
            bounds[:, 1] = np.sqrt(limits.centripetal_acceleration / bent)
    return bounds
