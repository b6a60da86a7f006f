"""Plans on rigid bodies: a linear model for the search, and MuJoCo, which judges."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.certification._uses import (
    SPEED_SLACK,
    Robot,
    Setting,
    Uses,
    assigned_speeds,
    command_use,
    planned_uses,
)
from armcontour.core.fields import Checked
from armcontour.core.result import VERDICT, Data, Row
from armcontour.execution import RigidBodyPlant, execute
from armcontour.geometry import Path
from armcontour.motion import Execution, TaughtData
from armcontour.robustness.bodies import BodyRuns, describe, spread_on_bodies
from armcontour.robustness.box import Box
from armcontour.robustness.deviations import Deviations, Worst, deviations_of
from armcontour.robustness.monte_carlo import Spread
from armcontour.robustness.unknowns import Unknowns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinearFigures(Checked):
    """What the linear model of rigid bodies says of a plan, against the figures of MuJoCo.

    Args:
        nominal: Largest contour error of the nominal robot [m].
        bound: Largest contour error of all robots of the box [m]. It is exact in the linear model,
            to first order: no robot of the box has more in it.
        corner: The robot that has it, in words.
        shares: Parts of the bound by kinds of unknowns, and of "sampling", which is what the
            nominal robot has of it [m].
        drawn: Largest contour errors of robots drawn from the box [m], (n,).
        seed: Seed of these robots.
    """

    nominal: float
    bound: float
    corner: str
    shares: Mapping[str, float] = field(default_factory=dict)
    drawn: FloatArray
    seed: int

    def to_data(self, budget: float) -> Data:
        """The bound, its worst robot and its parts.

        Args:
            budget: Largest allowed error [m].
        """
        label = "contour error of all robots of the box"
        drawn = f"{len(self.drawn)} drawn robots"
        parts = [
            Row(f"shares.{kind}", x, "m", f"of it {kind}", level=VERDICT)
            for kind, x in self.shares.items()
        ]
        return Data(
            "Linear model of rigid bodies",
            (
                Row("bound", self.bound, "m", label, f"worst robot {self.corner}", VERDICT),
                *(parts or [Row("shares", {})]),
                Row("nominal", self.nominal, "m"),
                Row("corner", self.corner),
                Row("drawn.robots", len(self.drawn)),
                Row("drawn.seed", self.seed),
                Row("drawn.max", self.drawn.max(), "m", drawn, level=VERDICT),
                Row("drawn.within", self.within(budget), "1"),
            ),
        )

    def within(self, budget: float) -> float:
        """Fraction of the drawn robots whose largest contour error is at most `budget` [m]."""
        return float(np.mean(self.drawn <= budget))


def uses_on_bodies(setting: Setting, taught: TaughtData) -> Uses:
    """The uses of a plan, its command, and its execution by the linear model.

    Args:
        setting: What is fixed.
        taught: The set-points.
    """
    deviations = look(setting, taught)
    across = deviations.across()
    worst = across.worst()
    t = across.t
    s, joints, pace = planned_uses(setting, taught.trajectory, t)
    pace = np.maximum(pace, command_use(setting, taught, t))
    error = np.linalg.norm(across.nominal, axis=1)
    faster = _tool_speed(setting, deviations) / (assigned_speeds(setting, s) * (1 + SPEED_SLACK))
    # What the path bends within the deviation is of second order; the corners of the moments tell.
    over_box = np.maximum(worst.bound, deviations.distances(worst.errors))
    rms = 0.0 if setting.rms is None else float(np.sqrt(np.mean(error**2))) / setting.rms
    return Uses(
        t=t,
        s=s,
        joints=joints,
        pace=pace,
        tool=faster**2,
        error=error / setting.budget,
        box=None if setting.box is None else over_box / setting.budget,
        peak=np.zeros(setting.arm.dof),
        rms=rms,
        largest=float(error.max()),
        linear=worst,
    )


def _tool_speed(setting: Setting, deviations: Deviations) -> FloatArray:
    """Tool speed of the nominal robot in the linear model [m/s], (n,)."""
    q = deviations.q + deviations.nominal
    dq = np.gradient(q, deviations.t, axis=0)
    return np.asarray(np.linalg.norm(setting.arm.tool_velocity(q, dq), axis=1))


def look(setting: Setting, taught: TaughtData) -> Deviations:
    """The linear model of the box around a plan; without a box, of the nominal robot alone."""
    return deviations_of(
        taught,
        setting.path,
        Unknowns.of(setting.box or Box(), setting.arm, setting.servo),
        gravity_feedforward=setting.drive_options.get("gravity_feedforward", True),
    )


def rest_at_start(robot: Robot, path: Path, taught: TaughtData) -> float:
    """Distance from the tool to the start of its path while the robot rests at it [m].

    Args:
        robot: The robot.
        path: The path.
        taught: Set-points along the path.

    Raises:
        ExecutionError: The drives are too weak to hold the robot, or do not settle.
    """
    standing = replace(taught, q=np.tile(taught.q[0], (2, 1)))
    executed = execute(standing, robot.plant(), resolution=robot.resolution)
    return float(np.linalg.norm(executed.tool[0] - path(0.0)))


def execute_bodies(
    setting: Setting,
    taught: TaughtData,
    worst: Worst,
    errors: FloatArray,
    *,
    executor: Executor | None = None,
    progress: Progress,
    seed: int | None = None,
) -> Spread:
    """Execute on robots of the box as rigid bodies, in several processes if they are many.

    Args:
        setting: What is fixed.
        taught: The set-points.
        worst: What the linear model says, for its unknowns.
        errors: Errors of the unknowns, (n, k).
        executor: An executor that does it in place of processes of this machine.
        progress: Called with the share that is done.
        seed: Seed of the errors; None for corners.
    """
    runs = BodyRuns(
        taught=taught,
        path=setting.path,
        unknowns=worst.across.unknowns,
        limits=setting.limits,
        options=setting.drive_options,
    )
    what = "corners of the box" if seed is None else "robots of the box"
    names = (f"{len(errors)} {what} as rigid bodies",)

    def tell(done: int) -> None:
        progress(Step(names, done / (len(errors) + 1)))

    return spread_on_bodies(runs, errors, seed=seed, executor=executor, done=tell)


def figures(worst: Worst, samples: int, seed: int) -> LinearFigures:
    """The figures of the linear model.

    Args:
        worst: What it says.
        samples: Number of robots drawn from the box.
        seed: Seed of these.
    """
    across = worst.across
    unknowns = across.unknowns
    return LinearFigures(
        nominal=float(np.linalg.norm(across.nominal, axis=1).max()),
        bound=worst.largest,
        corner=describe(unknowns, worst.errors[int(np.argmax(worst.bound))]),
        shares=worst.shares(),
        drawn=across.largest(unknowns.draw(samples, seed)),
        seed=seed,
    )


def torque_ratio(setting: Setting, executed: Execution) -> float:
    """Largest torque that a drive would need in an execution over its limit."""
    plant = setting.plant()
    assert isinstance(plant, RigidBodyPlant) and executed.torque_demand is not None
    return float(np.max(np.abs(executed.torque_demand) / plant.torque_limit))
