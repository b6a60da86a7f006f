"""Check of the commands into which a controller interpolates the points of a trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmMismatch
from armcontour.core.fields import checked
from armcontour.core.quantities import Choice, Frequency, NotNegative, Quantity, Tolerance
from armcontour.core.render import Result, moment, number
from armcontour.core.result import VERDICT, Data, Row, Table, with_decimals
from armcontour.core.sampled_data import subdivide
from armcontour.geometry import Path
from armcontour.motion import Trajectory
from armcontour.motion.controller_laws import CONTROLLERS, NAMES, CommandCurve, interpolate_points
from armcontour.program import Program
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.limit_use import use_of
from armcontour.verification.limit_verdict import VERDICTS, LimitUse, PathDeviation
from armcontour.verification.trajectory_check import STEPS_SHOWN, TimeSamples, check

# Largest number of times per interval of a law at which the distance from the path is computed.
# With 32 times per interval, the peak of a smooth error exceeds the largest computed value by at
# most 0.3 %.
MAX_DISTANCES_PER_INTERVAL = 32
# Total number of times above which intervals have fewer times than MAX_DISTANCES_PER_INTERVAL.
MAX_DISTANCES = 400_000
# Interpolations whose velocity is discontinuous at the points.
IN_STEPS = ("lines", "held", "next point")
# Fraction by which commands may exceed a limit, because interpolation adds up to this fraction to a
# valid plan with limited jerk.
COMMAND_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InterpolationCheck(Result):
    """Result of `check_interpolation`.

    Args:
        controller: Name of the controller.
        law: Interpolation of the points by the controller.
        rate: Rate of the controller [1/s].
        uses: Uses of the limits by the commands. Velocities are first differences of the commands
            over a cycle, accelerations are second differences.
        deviation: Largest distance of the tool from the reference at the same time [m].
        deviation_time: Time of `deviation` since the first point [s].
        joint_deviation: Largest distance of a joint from the reference [rad].
        reference: Name of the reference.
        acceleration: Largest ratio of the acceleration of the interpolation to the limit; NaN if
            its velocity is discontinuous, or without a limit.
        path_deviation: Largest distance from the path; None without a path.
    """

    controller: str
    law: str
    rate: float
    uses: tuple[LimitUse, ...]
    deviation: float
    deviation_time: float
    joint_deviation: float
    reference: str
    acceleration: float
    path_deviation: PathDeviation | None

    @property
    def verdict(self) -> str:
        """The verdict on the commands: "violated", "cannot tell" or "kept"."""
        return max((x.verdict for x in self.uses), key=VERDICTS.index, default="kept")

    def __getitem__(self, name: str) -> LimitUse:
        """Return the use of a limit by its name."""
        return next(x for x in self.uses if x.name == name)

    def to_data(self) -> Data:
        """Return the verdict, the distances, and the use of every limit."""
        title = CONTROLLERS[self.controller].title
        rate = number(self.rate, "Hz")
        farthest = self.path_deviation
        # Neighbouring commands have different times.
        decimals = max(0, math.ceil(math.log10(STEPS_SHOWN * self.rate)))
        path = ""
        distance = None
        if farthest is not None:
            path = f"at t = {moment(farthest.t, decimals)}, s = {number(farthest.s, 'm')}"
            distance = farthest.distance
        time = f"from {self.reference}, at t = {moment(self.deviation_time, decimals)}"
        limits = [with_decimals(x.to_data().rows, decimals) for x in self.uses]
        return Data(
            "Commands",
            (
                Row("verdict", self.verdict, "", "verdict", f"{title} at {rate}", VERDICT),
                *(Row(x, getattr(self, x)) for x in ("controller", "reference")),
                Row("rate", self.rate, "Hz"),
                Row("law", self.law, "", "interpolation"),
                # If the plan is unknown, quintics and cubics are their own reference, so a
                # deviation of 0 is not displayed.
                Row("deviation", self.deviation, "m", "deviation" * (self.deviation > 0), time),
                Row("deviation_time", self.deviation_time, "s"),
                Row("joint_deviation", self.joint_deviation, "rad"),
                Row("path_deviation", distance, "m", "distance from path", path),
                Row("acceleration", self.acceleration, "1", "acceleration of the interpolation"),
            ),
            (Table.from_rows("limits", limits),),
        )


@checked
def check_interpolation(
    points: TimeSamples,
    arm: Arm,
    controller: Annotated[str, Choice(NAMES)],
    rate: Frequency,
    limits: Limits | None = None,
    path: Path | Program | None = None,
    *,
    reference: Trajectory | None = None,
    deviation: Tolerance | None = None,
    orientation_deviation: Annotated[float, Quantity("rad", sign="positive")] | None = None,
    tolerance: NotNegative = COMMAND_TOLERANCE,
) -> InterpolationCheck:
    """Check a trajectory as a controller interpolates it.

    Velocities and accelerations of joints and tool are differences of the commands at the
    controller's rate. Jerk is not checked. Distances are evaluated on the interpolation at any
    time, without the delay of the controller.

    Args:
        points: The trajectory, as in `armcontour.motion.controller_laws.interpolate_points`.
        arm: The arm.
        controller: Name of the controller.
        rate: Rate of the controller [1/s].
        limits: Limits instead of those of the arm.
        path: The path or program that the tool should follow.
        reference: The motion that was sampled; by default the quintics, cubics or the clamped
            spline through the points.
        deviation: Permitted distance of the tool from the path [m].
        orientation_deviation: Permitted angle from the required tool orientation [rad].
        tolerance: Fraction by which commands may exceed a limit.

    Raises:
        InvalidInput: The controller does not accept these points, or they do not fit the arm.
    """
    curve = interpolate_points(points, controller)
    if (dof := curve.curve.dof) != arm.dof:
        raise ArmMismatch(f"The arm {arm.name} has {arm.dof} joints, but the trajectory has {dof}.")
    bounds = resolve_limits("check_interpolation", arm, limits)
    t, q = curve.commands(rate)
    commanded = SimpleNamespace(t=t, q=q)
    uses = check(commanded, arm, bounds.without_jerk, path, tolerance=tolerance).uses
    times = _times(points)
    path_deviation = None
    if path is not None:
        fine = SimpleNamespace(t=times, q=curve(times))
        followed = check(
            fine, arm, Limits.only(), path,
            deviation=deviation, orientation_deviation=orientation_deviation, tolerance=tolerance,
        )  # fmt: skip
        uses = uses + followed.uses
        path_deviation = followed.path_deviation
    # If the plan is unknown, it is estimated by the spline with the positions and derivatives of
    # the points.
    spline = interpolate_points(points, "jtc_spline")
    ideal = reference or spline.curve
    q = curve(times)
    exact = ideal(np.minimum(times, ideal.duration))
    distance = np.linalg.norm(arm.tool_position(q) - arm.tool_position(exact), axis=1)
    return InterpolationCheck(
        controller=controller,
        law=curve.law,
        rate=rate,
        uses=uses,
        deviation=float(distance.max()),
        deviation_time=float(times[np.argmax(distance)]),
        joint_deviation=float(np.abs(q - exact).max()),
        reference="the plan" if reference else f"{spline.law} through the points",
        acceleration=_law_acceleration(curve, bounds, times),
        path_deviation=path_deviation,
    )


def _times(points: TimeSamples) -> FloatArray:
    """Return times at the points and between them, from the first point [s], (n,)."""
    t = np.round(np.asarray(points.t) - points.t[0], 9)
    return subdivide(t, int(np.clip(MAX_DISTANCES // len(t), 2, MAX_DISTANCES_PER_INTERVAL)))


def _law_acceleration(curve: CommandCurve, limits: Limits, t: FloatArray) -> float:
    """Return the interpolation's largest acceleration / limit; NaN if velocity jumps.

    - `t`: times from the first point [s], (n,).
    """
    if curve.law in IN_STEPS or limits.joint_acceleration is None:
        return np.nan
    curve_times = np.clip(t + curve.origin, 0.0, curve.curve.duration)
    sides = (curve.curve(curve_times, 2, side=x) for x in ("left", "right"))
    return max(float(use_of("joint_acceleration", limits, x).ratio.max()) for x in sides)
