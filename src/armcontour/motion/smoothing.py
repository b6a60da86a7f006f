"""Smoothing of a trajectory: a moving average over time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.geometry import ShapedPath
from armcontour.motion.joint_average import average_joints
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import Law, PathLaw, Rates
from armcontour.motion.path_average import SmoothedLaw
from armcontour.motion.trajectory import Trajectory

# Joints whose derivatives with respect to the path are below this are at rest at a clamped end.
NO_RATE = 1e-12


def smooth(trajectory: Trajectory, *windows: float) -> Trajectory:
    """The trajectory along the same path with the arc length s(t) averaged over time.

    One window makes path accelerations continuous; a second window bounds their rate of change.
    Stops remain: each part between two stops is averaged by itself, and takes longer by the sum of
    the windows.

    Along the curve of a shaped path, whose curvature jumps where accelerations do, the joint
    positions are averaged instead. (A shaped path of arcs or stops, where these are the fastest,
    has no such curve.) The joints then keep all limits of velocity and acceleration that the motion
    keeps, and the tool leaves the path by about a W² / 24, for a tool acceleration a and a window
    W.

    Args:
        trajectory: Trajectory along joint paths from rest to rest, such as by method "optimal".
        windows: Lengths of one or two windows, above 0 [s].

    Raises:
        InvalidInput: The number of windows is wrong, a law is not along a joint path, or a law does
            not start or end at rest.
    """
    if len(windows) not in (1, 2):
        raise InvalidInput(f"A trajectory is smoothed over one or two windows, not {len(windows)}.")
    lengths = sorted((_checks.positive("window", x, "s") for x in windows), reverse=True)
    pair = (lengths[0], lengths[1] if len(lengths) == 2 else 0.0)
    laws: list[Law] = []
    for law in trajectory.laws:
        if not isinstance(law, PathLaw):
            raise InvalidInput(
                "Only motions along a joint path can be smoothed, and the method "
                f"{trajectory.method} plans joint by joint: plan with the method optimal."
            )
        jumps = averages_joints(law.joint_path)
        laws += [
            average_joints(x, pair) if jumps else SmoothedLaw(law=x, windows=pair)
            for x in _between_rests(law)
        ]
    return Trajectory(
        laws=tuple(laws),
        method=f"{trajectory.method}, smoothed",
        path=trajectory.path,
        arm=trajectory.arm,
        limits=trajectory.limits,
        reserve=trajectory.reserve,
    )


def averages_joints(joint_path: JointPath) -> bool:
    """Whether smoothing averages the joints: the path was shaped, and its curvature jumps."""
    path = joint_path.tool_path
    return isinstance(path, ShapedPath) and path.curve is not None


def _between_rests(law: PathLaw) -> Iterator[PathLaw]:
    """The parts of a law between times at rest.

    Raises:
        InvalidInput: The law does not start or end at rest.
    """
    speeds = law.speeds
    # The last speed comes from the formula of the last interval, and has rounding errors.
    speeds[-1] = 0.0 if abs(speeds[-1]) < 1e-9 * speeds.max() else speeds[-1]
    for place, at in (("begins", 0), ("ends", -1)):
        if speeds[at] != 0:
            path = law.joint_path
            along = "m/s" if path.tool_path is not None else "rad/s along the joint path"
            clamped = np.abs(path(law.s[[at]], 1)).max() < NO_RATE
            cure = (
                'a joint path with ends="natural"' if clamped else "without start_speed, end_speed"
            )
            raise InvalidInput(
                f"A motion that {place} at {speeds[at]:.3g} {along} cannot be smoothed: its "
                f"average is from rest to rest; plan {cure}."
            )
    rests = np.flatnonzero(speeds == 0)
    for a, b in zip(rests[:-1], rests[1:], strict=True):
        breaks = law.breaks[a : b + 1] - law.breaks[a]
        rates = Rates(*(x[a:b] for x in law.rates))
        yield PathLaw(joint_path=law.joint_path, breaks=breaks, s=law.s[a : b + 1], rates=rates)
