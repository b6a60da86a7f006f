"""`PlanOptions`: options of a timing method, and values that the methods share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Self

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.core.fields import Options, declared
from armcontour.core.progress import Progress
from armcontour.core.quantities import (
    NO_KEY,
    AtLeast,
    Quantity,
    Reserve,
)
from armcontour.motion import JointPath, Method, Trajectory
from armcontour.planning.constraints import Constraint
from armcontour.planning.path_grid import FEWEST_PER_PIECE, MAX_INTERVALS
from armcontour.program import Program
from armcontour.robot import Arm, Limits

# Largest duration [s], about eleven days. Longer durations are mistakes, and times are rounded to a
# nanosecond.
LONGEST_MOTION = 1e6
IntervalCount = Annotated[int, AtLeast(FEWEST_PER_PIECE, MAX_INTERVALS)]
# Largest number of iterations of each pass with limits of jerk.
MAX_ITERATIONS = 150
# How to plan without limits of jerk, for messages.
WITHOUT_JERK = (
    "remove joint_jerk with limits.replace(joint_jerk=math.inf) (in a job, "
    "limits: {joint_jerk: inf})"
)
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
        for_play: Whether the reserve is also one of the limits of joint jerk, tool acceleration and
            angular acceleration, so that the override can change during a motion with `play`.
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
    # True if a run can have leads of automatic length, after which the tool has full speed
    automatic_leads: ClassVar[bool] = False
    # True if the method plans along lines and arcs only
    only_arcs: ClassVar[bool] = False
    # True if the tool passes corners without a stop
    passes_corners: ClassVar[bool] = False
    # True if the plan can exceed the limits of joint velocity and acceleration
    ignores_joint_limits: ClassVar[bool] = False
    # True if `reshape` changes the path, so that the method cannot plan along a given joint path
    changes_path: ClassVar[bool] = False
    reserve: Reserve = 0.0
    for_play: Annotated[bool, NO_KEY] = False
    configuration: Annotated[str | None, NO_KEY] = None
    seed: Annotated[Annotated[FloatArray, Quantity("rad", "10 deg")] | None, NO_KEY] = None
    accept: Annotated[Callable[[JointPath], bool] | None, NO_KEY] = None

    def reshape(
        self, program: Program, arm: Arm, limits: Limits, progress: Progress | None, *, named: bool
    ) -> Program:
        """Return the program with the paths along which the method plans.

        Args:
            program: The program.
            arm: The arm.
            limits: Limits of the plan.
            progress: Called with the step and the fraction done.
            named: Whether error messages start with the name of the contour.
        """
        return program

    def time(self, joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
        """Plan the motion along a contour.

        Args:
            joint_path: The joint path of the contour.
            arm: The arm.
            limits: Limits less the reserve, one value per joint.

        Raises:
            NotRealizable: The method cannot satisfy the limits.
        """
        raise NotImplementedError

    def check_jerk(self, limits: Limits) -> None:
        """Refuse limits of jerk unless the method keeps them.

        Args:
            limits: The limits of the plan.

        Raises:
            NotRealizable: The method does not support the given limits of jerk.
        """
        if limits.limits_jerk:
            raise NotRealizable(
                f"The method {self.method} does not support limits of jerk, but joint_jerk is "
                "given. Plan by the method optimal (in a job, timing: {method: optimal}), or "
                f"{WITHOUT_JERK}.",
                limit="joint_jerk",
            )

    def at_cycle(self, cycle: float) -> Self:
        """Return the options for a controller cycle.

        Args:
            cycle: Cycle [s]; most methods do not depend on it.
        """
        return self

    def without_duration(self) -> Self:
        """Return the options for a motion as fast as possible."""
        return self

    def for_program(self, program: Program) -> Self:
        """Return the options for the contours of a program.

        Args:
            program: The program.

        Raises:
            InvalidInput: An option applies to a single path only, but the program has several.
        """
        return self


@dataclass(frozen=True, slots=True)
class Task:
    """Planning problem with limits of jerk."""

    active: tuple[Constraint, ...]  # The constraints of the planner without jerk
    jerk: FloatArray  # Limits of joint jerk, infinite without a limit [rad/s³], (dof,)
    cells: int | None = None  # Approximate number of cells; None for the default
    # Largest number of iterations of each pass. Every iterate satisfies all limits.
    iterations: int = MAX_ITERATIONS
