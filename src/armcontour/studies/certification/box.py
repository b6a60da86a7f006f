"""Contour errors of a program on robots of a box: its corners, and robots drawn from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.pool import map_in_threads
from armcontour.core.render import Result
from armcontour.core.result import VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.motion import SetPoints
from armcontour.robot.servo import ServoModel
from armcontour.simulation import simulate
from armcontour.studies.certification.certification_case import Case
from armcontour.verification.contour_errors import pieces_of

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
    """

    max: FloatArray
    names: tuple[str, ...]
    deviations: FloatArray

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


def execute_box(case: Case, set_points: SetPoints) -> list[BoxErrors]:
    """Execute a program on robots of the box of a case; returns the errors of each contour.

    If k parameters are uncertain, all 2^k corners of the box are executed, or if these are more
    than MAX_CORNERS, corners that a search finds. DRAWN more robots are drawn from the box, because
    the worst robot need not be in a corner.
    """
    assert case.box is not None
    half_widths = case.box.half_widths(case.servo, case.arm.dof).ravel()
    varies = half_widths > 0
    shared = case.box.dead_time_shared
    if shared:
        varies[2 * case.arm.dof + 1 :] = False

    def deviations(unit: FloatArray) -> FloatArray:
        """Errors of all parameters of robots in units of the box, (n, 3 dof)."""
        rows = np.zeros((len(unit), len(half_widths)))
        rows[:, varies] = unit
        if shared:
            rows[:, 2 * case.arm.dof :] = rows[:, 2 * case.arm.dof, None]
        return rows * half_widths

    def errors(unit: FloatArray) -> FloatArray:
        """Largest contour errors of robots in units of the box, (n, contours)."""
        robots = list(deviations(unit))
        return np.array(map_in_threads(partial(_contour_errors, case, set_points), robots))

    k = int(varies.sum())
    if 2**k <= MAX_CORNERS:
        corners = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, -1.0, 1.0)
        found = errors(corners)
    else:
        corners, found = _search_corners(errors, k)
    drawn = np.random.default_rng(SEED).uniform(-1, 1, size=(DRAWN, k))
    largest = np.concatenate([found, errors(drawn)])
    joints = range(1, case.arm.dof + 1)
    names = [f"{x} of joint {j}" for x in ("kp", "kv", "dead time") for j in joints]
    if shared:
        names[2 * case.arm.dof] = "dead time"
    kept = tuple(x for x, on in zip(names, varies, strict=True) if on)
    robots = deviations(np.concatenate([corners, drawn]))[:, varies]
    return [BoxErrors(max=x, names=kept, deviations=robots) for x in largest.T]


def servo_with(servo: ServoModel, deviations: FloatArray) -> ServoModel:
    """The servo with errors of kp, kv (relative) and dead time [s], (3, dof) or (3 dof,)."""
    kp, kv, dead_time = deviations.reshape(3, -1)
    return servo.replace(
        kp=servo.kp * (1 + kp),
        kv=None if servo.kv is None else servo.kv * (1 + kv),
        dead_time=np.maximum(servo.dead_time + dead_time, 0.0),
    )


def _contour_errors(case: Case, set_points: SetPoints, deviations: FloatArray) -> list[float]:
    """Largest contour error of each contour on one robot, of both directions [m]."""
    plant = case.plant(servo_with(case.servo, deviations))
    resolution = min(RESULT_STEP, set_points.cycle)
    executed = simulate(set_points, plant, resolution=resolution)
    pieces = pieces_of(executed, case.program, None, None)
    return [max(x.contour_error.max, x.coverage_error.max) for x in pieces]


def _search_corners(
    errors: Callable[[FloatArray], FloatArray], k: int
) -> tuple[FloatArray, FloatArray]:
    """Signs of the corners to execute if the box has more than MAX_CORNERS, and their errors."""
    # errors: function from signs, (n, k), to contour errors [m], (n, contours). First the corner
    # with the worse sign of each single parameter, then the corners of a search from there that
    # changes one sign per step while the error increases, then random corners.
    single = errors(np.concatenate([np.eye(k), -np.eye(k)])).max(axis=1)
    best = np.where(single[:k] >= single[k:], 1.0, -1.0)
    corners = np.stack([best, -best])
    found = errors(corners)
    worst = found[0].max()
    while len(corners) + k <= MAX_CORNERS:
        neighbours = np.where(np.eye(k, dtype=np.bool_), -best, best)
        tried = errors(neighbours)
        corners, found = np.concatenate([corners, neighbours]), np.concatenate([found, tried])
        i = int(np.argmax(tried.max(axis=1)))
        if tried[i].max() <= worst:
            break
        best, worst = neighbours[i], tried[i].max()
    random = np.random.default_rng(SEED).choice([-1.0, 1.0], size=(MAX_CORNERS - len(corners), k))
    return np.concatenate([corners, random]), np.concatenate([found, errors(random)])
