"""Options of the timing methods, one class per method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Options, declared
from armcontour.core.quantities import (
    About,
    AngularDistance,
    AtLeast,
    Distance,
    Interval,
    Quantity,
    Reserve,
)
from armcontour.core.render import number
from armcontour.core.text import show
from armcontour.motion import DEFAULT_CYCLE, JointPath, Method, check_cycle
from armcontour.planning.constraints import FROM_LIMITS, Constraint
from armcontour.planning.path_grid import FEWEST_PER_PIECE, MAX_INTERVALS

# Largest duration [s], about eleven days. Longer durations are mistakes, and times are rounded to a
# nanosecond.
LONGEST_MOTION = 1e6
MotionTime = Annotated[
    float, Quantity("s", "6.5 s", within=(checks.SMALLEST_NUMBER, LONGEST_MOTION))
]
Intervals = Annotated[int, AtLeast(FEWEST_PER_PIECE, MAX_INTERVALS)]
# Marks a field that is a key of a job; the other fields have a key elsewhere, or no key.
KEY = About()
PathSpeed = Annotated[float, Quantity("m/s", "0.15 m/s", "not negative")]
# Smallest number of intervals per line of the paper's method. With fewer, a short line from rest to
# rest has none left for its motion.
FEWEST_LAPS = 8
# Largest number of intervals per line of the paper's method, which needs several GB for an arm with
# six joints.
MAX_LAPS = 5_000_000
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
class Optimal(PlanOptions):
    """Options of the method "optimal", in addition to those of `PlanOptions`.

    The method computes the fastest timing that satisfies every limit.

    >>> slow = ac.plan(path, arm, limits, ac.Optimal(duration=2.0))
    >>> round(slow.duration, 6)
    2.0

    Args:
        duration: Required duration [s]. All contours are slowed down by one factor; rapids and
            dwells are not. By default the motion is the fastest.
        intervals: Approximate number of grid intervals of each contour; by default 4000, fewer for
            a program of many contours.
        iterations: Largest number of iterations with limits of jerk. A plan that was stopped early
            is slower, and satisfies all limits.
        start_speed: Path speed at the start of a single path [m/s]; 0 with limits of jerk.
        end_speed: Path speed at the end of a single path [m/s]; 0 with limits of jerk.
        from_limits: Kinds of constraints: subclasses of `Constraint` that serve fields of `Limits`.
            For each plan, the planner makes a constraint of each kind from the limits. Replace a
            kind to plan its limits with a formula of your own. A limit that no kind serves is
            refused; to plan without it, remove it from the limits.
        constraints: Constraints of your own, in addition to the limits: objects that are ready,
            such as `SecondOrder(...)`. `explain` needs them again, because a plan does not contain
            them.

    Raises:
        InvalidInput: A value of the wrong type or out of range, or a motion of a given duration
            that starts or ends at a speed.
    """

    method = Method.OPTIMAL
    duration: MotionTime | None = None
    intervals: Intervals | None = None
    iterations: Annotated[int, AtLeast(1, MAX_ITERATIONS)] = MAX_ITERATIONS
    start_speed: PathSpeed = 0.0
    end_speed: PathSpeed = 0.0
    from_limits: tuple[type[Constraint], ...] = field(default=FROM_LIMITS, repr=False)
    constraints: tuple[Constraint, ...] = ()

    def _check_together(self) -> None:
        for kind in self.from_limits:
            if not (isinstance(kind, type) and issubclass(kind, Constraint) and kind.serves):
                raise InvalidInput(
                    "from_limits must contain subclasses of Constraint whose `serves` names fields "
                    f"of Limits, but it contains {show(kind)}. Pass a constraint that is "
                    "ready in constraints."
                )
        for name in ("start_speed", "end_speed"):
            if self.duration is not None and getattr(self, name):
                raise InvalidInput(
                    f"A motion with a given duration starts and ends at rest, but {name} is "
                    f"{number(getattr(self, name), 'm/s')}. Remove {name} or duration."
                )


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
    intervals: Intervals | None = None


@declared(eq=False)
class Paper(PlanOptions):
    """Options of the paper's method for lines and arcs, in addition to those of `PlanOptions`.

    >>> straight = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    >>> ac.plan(straight, arm, limits, ac.Paper(knots=10)).method
    <Method.PAPER: 'paper'>

    Args:
        knots: Intervals of equal length per line. By default the distance between knots is at most
            the travel of the tool in one cycle at the assigned velocity. An interval next to a rest
            is subdivided.
        cycle: Cycle [s].

    Raises:
        InvalidInput: A value of the wrong type or out of range.
    """

    method = Method.PAPER
    knots: Annotated[Annotated[int, AtLeast(FEWEST_LAPS, MAX_LAPS)] | None, KEY] = None
    cycle: Interval = DEFAULT_CYCLE

    def _check_together(self) -> None:
        check_cycle(self.cycle)


@declared(eq=False)
class Conventional(PlanOptions):
    """Options of the method "conventional", uniform tool speed: those of `PlanOptions`.

    >>> straight = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    >>> ac.plan(straight, arm, limits, ac.Conventional()).method
    <Method.CONVENTIONAL: 'conventional'>
    """

    method = Method.CONVENTIONAL


FASTEST = Optimal()
# Options by method, for the methods that do not change the path.
METHODS: dict[str, type[PlanOptions]] = {x.method.value: x for x in (Optimal, Paper, Conventional)}


@dataclass(frozen=True, slots=True)
class Task:
    """Planning problem with limits of jerk."""

    active: tuple[Constraint, ...]  # The constraints of the planner without jerk
    jerk: FloatArray  # Limits of joint jerk, infinite without a limit [rad/s³], (dof,)
    cells: int | None = None  # Approximate number of cells; None for the default
    # Largest number of iterations of each pass. Every iterate satisfies all limits.
    iterations: int = MAX_ITERATIONS
