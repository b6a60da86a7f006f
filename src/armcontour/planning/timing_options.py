"""`PlanOptions`: options of a timing method, and values that the methods share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

from armcontour.core.checks import FloatArray
from armcontour.core.fields import Options, declared
from armcontour.core.quantities import (
    About,
    AngularDistance,
    AtLeast,
    Distance,
    Quantity,
    Reserve,
)
from armcontour.motion import JointPath, Method
from armcontour.planning.constraints import Constraint
from armcontour.planning.path_grid import FEWEST_PER_PIECE, MAX_INTERVALS

# Largest duration [s], about eleven days. Longer durations are mistakes, and times are rounded to a
# nanosecond.
LONGEST_MOTION = 1e6
IntervalCount = Annotated[int, AtLeast(FEWEST_PER_PIECE, MAX_INTERVALS)]
# Largest number of iterations of each pass with limits of jerk.
MAX_ITERATIONS = 150
# Default number of iterations of shaping.
DEFAULT_ITERATIONS = 60
# Largest number of iterations of shaping.
MAX_SHAPES = 10_000


@declared(eq=False)
class PlanOptions(Options):
    """Options of all timing methods.

    Args:
        reserve: Fraction of the limits of joint acceleration and torque that the plan leaves to the
            servo. With a reserve of 0, a lagging servo cannot catch up.
        configuration: For an arm in the plane: the branch of its inverse kinematics; by default the
            one that is fastest along the path.
        seed: For an arm in space: joint positions near the required start [rad], (dof,); by
            default the configuration that is fastest along the path.
        accept: Returns whether the arm may follow a joint path, such as `Cell(arm, scene).fits`.
            The fastest accepted configuration is used, and the fastest of all if none is accepted.
            By default collisions are ignored; `check_clearance` finds those of a plan.

    Raises:
        InvalidInput: A value of the wrong type or out of range.
    """

    method: ClassVar[Method]
    reserve: Annotated[Reserve, About(usual=(0.0, 0.9))] = 0.0
    configuration: str | None = None
    seed: Annotated[FloatArray, Quantity("rad", "10 deg")] | None = None
    accept: Callable[[JointPath], bool] | None = None


@declared(eq=False)
class Shaped(PlanOptions):
    """Options of the method "shaped", in addition to those of `PlanOptions`.

    The method finds the fastest path within a tolerance of the given path.

    >>> options = ac.Shaped(tolerance=1e-3, iterations=1)
    >>> ac.plan(objective, arm, limits, options).duration < planned.duration
    True

    Args:
        tolerance: Largest distance of the path from the objective, and of the vertices of the
            objective from the path [m]; 0 stops at every vertex. Tolerances of the path's own
            segments cap it, and so does half of a stretch between two sharp corners.
        angular_tolerance: Largest angle between the tool and its required orientation [rad], as in
            `round_corners`.
        iterations: Largest number of iterations. The path satisfies all limits after each one.
        intervals: Approximate number of grid intervals of the plans that are compared.

    Raises:
        InvalidInput: A value of the wrong type or out of range.
    """

    method = Method.SHAPED
    tolerance: Distance
    angular_tolerance: AngularDistance | None = None
    iterations: Annotated[int, AtLeast(0, MAX_SHAPES)] = DEFAULT_ITERATIONS
    intervals: IntervalCount | None = None


@dataclass(frozen=True, slots=True)
class Task:
    """Planning problem with limits of jerk."""

    active: tuple[Constraint, ...]  # The constraints of the planner without jerk
    jerk: FloatArray  # Limits of joint jerk, infinite without a limit [rad/s³], (dof,)
    cells: int | None = None  # Approximate number of cells; None for the default
    # Largest number of iterations of each pass. Every iterate satisfies all limits.
    iterations: int = MAX_ITERATIONS
