"""`way_to_start`: how a robot that stands on the path of a job moves to the start of a motion.

After a stop, a resumed motion with `process.rejoin` or with leads begins before the robot, which
moves back along the path. After a stop between two contours it begins after the robot, which
completes the rapid. On a straight line in joint space, the tool would leave the path.
"""

from __future__ import annotations

from math import comb

import numpy as np

from armcontour.controllers.controller import START_TOLERANCE, START_TOLERANCE_LINEAR, per_joint
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused
from armcontour.core.render import number
from armcontour.jobs.run_result import RunResult
from armcontour.jobs.stopped_place import StoppedPlace
from armcontour.motion import JointPath
from armcontour.robot.arm import unit_of

# Rounded corners shorten a path, and a tool that has stopped is a little beyond the place of the
# stop, so it is also searched by this length after this place [m].
SEARCHED_BEYOND = 2e-3
# The nearest place is searched at so many places of the path, and in so many iterations more finely
# between the neighbours of the nearest one.
PLACES = 2001
ITERATIONS = 4
# A tool that is nearer to the path than this is at the place of its stop, where the joints must be
# those of the stop [m].
SAME_PLACE = 5e-3
# Joints that differ by at least this angle [rad] are in another configuration.
OTHER_CONFIGURATION = 0.2
# The same for a linear axis [m].
OTHER_CONFIGURATION_LINEAR = 0.05
# Powers of the parameter of a quintic.
POWERS = range(6)
# Coefficients of p(1 - x) are this matrix times those of p(x), for a quintic p.
REVERSED = np.array([[(-1.0) ** m * comb(k, m) for k in POWERS] for m in POWERS])


def way_to_start(planned: RunResult, position: FloatArray, start: FloatArray) -> JointPath | None:
    """Return the joint path to the start of a motion for a robot that stands on the job's path.

    It is `path_back` or `rapid_ahead`; None if the robot stands elsewhere.
    """
    way = path_back(planned, position, start)
    return rapid_ahead(planned, position, start) if way is None else way


def path_back(planned: RunResult, position: FloatArray, start: FloatArray) -> JointPath | None:
    """Return the joint path from a position on the path back to the start of a motion.

    It is the beginning of the planned joint path in reverse, with stops between its moves. None if
    the robot is not on the leads of the first contour, or on the part that is processed again.

    Args:
        planned: The plan of the motion.
        position: Joint positions of the robot [rad], (dof,).
        start: The first set-point [rad], (dof,).
    """
    parts = _beginning(planned)
    ratio, i, s = _nearest_part(planned, parts, position)
    if ratio > 1.0:
        return None
    passed = parts[:i]
    if s > parts[i].breaks[0]:
        passed.append(_until(parts[i], s))
    if not passed:
        return None
    return _with_ends(_joined([_reversed(x) for x in reversed(passed)]), position, start)


def rapid_ahead(planned: RunResult, position: FloatArray, start: FloatArray) -> JointPath | None:
    """Return the rest of the job's rapid to the contour with which a resumed motion begins.

    A straight line in joint space would leave out the rapid's lift. None if the robot is not on
    this rapid, or if the motion begins elsewhere than at its end.

    Args:
        planned: The plan of the resumed motion.
        position: Joint positions of the robot [rad], (dof,).
        start: The first set-point [rad], (dof,).
    """
    resumption = planned.resumption
    whole = None if resumption is None else resumption.whole
    if whole is None or not whole.rapid:
        return None
    parts = list(whole.rapid)
    end = parts[-1](parts[-1].breaks[-1])
    if (np.abs(end - start) > _tolerance(planned)).any():
        return None
    ratio, i, s = _nearest_part(planned, parts, position)
    if ratio > 1.0:
        return None
    left = parts[i + 1 :]
    length = float(parts[i].breaks[-1]) - s
    if length > 0.0:
        left.insert(0, _reversed(_until(_reversed(parts[i]), length)))
    if not left:
        return None
    return _with_ends(_joined(left), position, start)


def check_configuration(planned: RunResult, stop: StoppedPlace) -> None:
    """Refuse a resumed plan whose joints at the place of a stop are not those of the stop.

    If the robot has stopped between two contours, or away from the path, nothing is compared.

    Args:
        planned: The resumed plan.
        stop: The stop.

    Raises:
        ControllerRefused: The configuration is another one, also by a whole turn.
    """
    arm = planned.arm
    tool = arm.tool_position(stop.measured)
    best = (np.inf, stop.measured)
    for part in _beginning(planned):
        q = part(np.linspace(part.breaks[0], part.breaks[-1], PLACES))
        distances = np.linalg.norm(arm.tool_position(q) - tool, axis=1)
        k = int(distances.argmin())
        if distances[k] < best[0]:
            best = (float(distances[k]), q[k])
    distance, q = best
    allowed = per_joint(arm, OTHER_CONFIGURATION, OTHER_CONFIGURATION_LINEAR, arm.dof)
    difference = np.abs(q - stop.measured)
    j = int((difference / allowed).argmax())
    if distance > SAME_PLACE or difference[j] < allowed[j]:
        return
    unit = unit_of(arm, "rad", j)
    raise ControllerRefused(
        f"After the stop, joint {j + 1} was at {number(stop.measured[j], unit)}, but the rest of "
        f"the job has it at {number(q[j], unit)} there, which is another configuration. Play the "
        "job as it was played before the stop, with the same seed or start_from.",
        joint=j,
        needed=float(q[j]),
        allowed=float(stop.measured[j]),
    )


def _beginning(planned: RunResult) -> list[JointPath]:
    """Return the joint paths until the first contour has processed what is processed again."""
    traced = planned.traced
    assert traced is not None
    overlap = 0.0
    resumption = planned.resumption
    if resumption is not None and resumption.begin is not None:
        overlap = max(resumption.resume_at - resumption.begin, 0.0)
    parts = list[JointPath]()
    for step in traced.steps:
        if step.joint_path is None:
            continue
        if traced.is_contour(step):
            contour = planned.path.contours[0]
            end = contour.at_work[0] + overlap + SEARCHED_BEYOND
            parts.append(_until(step.joint_path, min(end, step.joint_path.breaks[-1])))
            break
        parts.append(step.joint_path)
    return parts


def _tolerance(planned: RunResult) -> FloatArray:
    """Return the distance from a place within which a robot stands there [rad], (dof,)."""
    arm = planned.arm
    return per_joint(arm, START_TOLERANCE, START_TOLERANCE_LINEAR, arm.dof)


def _nearest_part(
    planned: RunResult, parts: list[JointPath], position: FloatArray
) -> tuple[float, int, float]:
    """Find the place that is nearest to a position; return the ratio, the part's index, and s.

    The ratio is the largest distance of a joint, divided by its tolerance.
    """
    best = (np.inf, 0, 0.0)
    for i, part in enumerate(parts):
        ratio, s = _nearest(part, position, _tolerance(planned))
        best = min(best, (ratio, i, s))
    return best


def _nearest(path: JointPath, position: FloatArray, tolerance: FloatArray) -> tuple[float, float]:
    """Find the place of a path that is nearest to a position; return the ratio there, and s.

    The ratio is the largest distance of a joint, divided by its tolerance.
    """
    low = float(path.breaks[0])
    high = float(path.breaks[-1])
    ratio = np.inf
    nearest = low
    for _ in range(ITERATIONS):
        s = np.linspace(low, high, PLACES)
        ratios = (np.abs(path(s) - position) / tolerance).max(axis=1)
        i = int(ratios.argmin())
        ratio = float(ratios[i])
        nearest = float(s[i])
        low = float(s[max(i - 1, 0)])
        high = float(s[min(i + 1, PLACES - 1)])
    return ratio, nearest


def _until(path: JointPath, s: float) -> JointPath:
    """Return the part of a joint path before a parameter value."""
    count = max(int(np.searchsorted(path.breaks, s, side="left")), 1)
    breaks = np.append(path.breaks[:count], s)
    coefficients = path.coefficients[:count].copy()
    share = (s - breaks[-2]) / (path.breaks[count] - breaks[-2])
    coefficients[-1] *= share ** np.arange(len(POWERS))[:, None]
    return JointPath(breaks=breaks, coefficients=coefficients, stops=path.stops[path.stops < s])


def _reversed(path: JointPath) -> JointPath:
    """Return a joint path in the opposite direction, from 0."""
    end = path.breaks[-1]
    return JointPath(
        breaks=end - path.breaks[::-1],
        coefficients=np.einsum("mk,nkj->nmj", REVERSED, path.coefficients[::-1]),
        stops=end - path.stops[::-1],
    )


def _joined(parts: list[JointPath]) -> JointPath:
    """Return joint paths, each from 0, one after the other, with stops between them."""
    breaks = [np.zeros(1)]
    stops = list[FloatArray]()
    for part in parts:
        begin = breaks[-1][-1:]
        if len(breaks) > 1:
            stops.append(begin)
        stops.append(begin + part.stops)
        breaks.append(begin + part.breaks[1:])
    return JointPath(
        breaks=np.concatenate(breaks),
        coefficients=np.concatenate([x.coefficients for x in parts]),
        stops=np.concatenate(stops),
    )


def _with_ends(path: JointPath, first: FloatArray, last: FloatArray) -> JointPath:
    """Return a joint path with other ends, whose differences decrease linearly along the path."""
    at_first = first - path(path.breaks[0])
    at_last = last - path(path.breaks[-1])
    share = path.breaks / path.length
    coefficients = path.coefficients.copy()
    coefficients[:, 0] += at_first + share[:-1, None] * (at_last - at_first)
    coefficients[:, 1] += np.diff(share)[:, None] * (at_last - at_first)
    return JointPath(breaks=path.breaks, coefficients=coefficients, stops=path.stops)
