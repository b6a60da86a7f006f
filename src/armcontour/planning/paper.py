"""The paper's method, Sec. III-A, and the conventional method that the paper compares with.

Lines have maximum joint acceleration (`paper_line.py`). Corners are arcs at one speed, (16)-(17).
If a line is too short to reach the speed of a corner or to brake to it, the speed of that corner is
reduced to a value that the line can reach; the paper has no rule for this case.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, NotRealizable
from armcontour.geometry import Path
from armcontour.motion import JointPath, LawAlongPath, LawPhase, Method, Trajectory
from armcontour.planning.law_checks import (
    check_limits,
    law_peaks,
    path_law,
    require_speed,
    tool_path_of,
)
from armcontour.planning.options import FEWEST_LAPS, MAX_LAPS, Paper
from armcontour.planning.paper_line import PaperLine, RulePart, parts_by_rule
from armcontour.robot import Arm, Limits

# A lap next to a rest is divided into this many parts, because the speed changes much in it.
PARTS_AT_REST = 10
# Limits that the method guarantees; all others are checked on every part.
GUARANTEED = ("speed", "centripetal_acceleration")
# Limits that the conventional method ignores.
IGNORED = (*GUARANTEED, "joint_velocity", "joint_acceleration", "tool_acceleration")


@dataclass(slots=True)
class Junction:
    """Part of a path before, between or after lines: arcs at one speed, a vertex, or a stop."""

    arcs: range  # Segment indices of the arcs; empty where lines meet
    # Tool speed through the junction [m/s]; reduced to a value that the lines can reach
    speed: float


def plan_paper(joint_path: JointPath, arm: Arm, limits: Limits, options: Paper) -> Trajectory:
    """Plan a path of lines and arcs by the paper's method.

    The centripetal acceleration determines the corner speed (16).

    - `joint_path`: a traced path of lines and arcs.
    - `limits`: limits with joint accelerations and an assigned velocity.
    """
    path = tool_path_of(joint_path, "paper")
    assigned = np.fmin(path.speeds, require_speed(limits, "paper"))
    _refuse_limits(limits)
    junctions = _find_junctions(path, _find_lines(path), assigned, limits)
    lines = _make_lines(joint_path, arm, limits, assigned, junctions, options)
    _match_speeds(lines, junctions)
    return _join(lines, junctions, arm, limits)


def _find_lines(path: Path) -> list[int]:
    return list(np.flatnonzero(path.curvatures == 0).tolist())


def _make_lines(
    joint_path: JointPath,
    arm: Arm,
    limits: Limits,
    assigned: FloatArray,
    junctions: list[Junction],
    options: Paper,
) -> list[PaperLine]:
    path = tool_path_of(joint_path, "paper")
    lines = []
    for number, i in enumerate(_find_lines(path)):
        count = options.knots
        if count is None:
            count = _default_laps(path.lengths[i], assigned[i], options.cycle, number)
        at_rest = (junctions[number].speed == 0, junctions[number + 1].speed == 0)
        lines.append(
            PaperLine(
                name=f"line {number + 1}",
                joint_path=joint_path,
                arm=arm,
                limit=limits.acceleration_bounds(arm.dof)[1],
                s=_place_knots(path.breaks[i], path.breaks[i + 1], count, at_rest),
                assigned=float(assigned[i]),
            )
        )
    return lines


def _refuse_limits(limits: Limits) -> None:
    if limits.joint_acceleration is None:
        raise InvalidInput(
            "The method paper needs limits of joint acceleration, but none are specified. Specify "
            "joint_acceleration [rad/s²]."
        )
    if not limits.same_both_ways():
        raise InvalidInput(
            "The method paper supports one acceleration limit per joint for both directions. "
            "Specify one value of joint_acceleration per joint, or plan by the method optimal."
        )


def _default_laps(length: float, speed: float, cycle: float, number: int) -> int:
    """Number of laps of a line, so that a lap takes at most one cycle at the assigned velocity."""
    count = length / (speed * cycle)
    if not count <= MAX_LAPS:
        raise InvalidInput(
            f"Line {number + 1} would have {count:.3g} laps at {speed:g} m/s and a cycle of "
            f"{cycle:g} s, but at most {MAX_LAPS} are supported. Specify knots."
        )
    return max(FEWEST_LAPS, int(np.ceil(count)))


def _join(
    lines: list[PaperLine], junctions: list[Junction], arm: Arm, limits: Limits
) -> Trajectory:
    joint_path = lines[0].joint_path
    laws: list[LawAlongPath] = []
    stretches: list[LawPhase] = []
    corner = 0
    for number, line in enumerate(lines):
        pieces = line.plan(junctions[number].speed, junctions[number + 1].speed)
        laws += [x.law for x in pieces]
        parts = parts_by_rule(line.name, pieces)
        for i in junctions[number + 1].arcs:
            corner += 1
            parts.append(_arc_part(f"corner {corner}", joint_path, i, junctions[number + 1].speed))
            laws += parts[-1].laws
        for part in parts:
            start = stretches[-1].t[1] if stretches else 0.0
            stretches.append(_check_part(part, start, arm, limits))
    return Trajectory(
        laws=tuple(laws), method=Method.PAPER, path=joint_path.tool_path, stretches=tuple(stretches)
    )


def _find_junctions(
    path: Path, lines: list[int], assigned: FloatArray, limits: Limits
) -> list[Junction]:
    """Junctions of a path with their largest speeds: before the first line and after each line.

    `lines` are the indices of straight segments, `assigned` the velocity of each segment [m/s].
    """
    ends = np.concatenate([[-1], lines, [len(path)]])
    stop_vertices = set(np.searchsorted(path.breaks, path.stops).tolist())
    result = []
    for number, (before, after) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
        arcs = range(int(before) + 1, int(after))
        at_rest = number in (0, len(lines)) or any(
            vertex in stop_vertices for vertex in range(int(before) + 1, int(after) + 1)
        )
        if at_rest and len(arcs):
            s = float(path.breaks[arcs[0]])
            raise NotRealizable(
                f"At {s:.4g} m along the path the tool is at rest next to an arc, but the method "
                "paper moves along arcs only at constant speed: start and end the path on lines, "
                "or plan by the method optimal.",
                s=s,
                point=path(s).tolist(),
            )
        speeds = [assigned[i] for i in range(max(int(before), 0), min(int(after) + 1, len(path)))]
        if limits.centripetal_acceleration is not None:
            speeds += [
                float(np.sqrt(limits.centripetal_acceleration / path.curvatures[i])) for i in arcs
            ]
        result.append(Junction(arcs, 0.0 if at_rest else float(min(speeds))))
    return result


def _place_knots(start: float, end: float, count: int, at_rest: tuple[bool, bool]) -> FloatArray:
    """Arc lengths [m] of the knots of a line from `start` to `end` with `count` equal laps."""
    # A lap next to a rest is divided into parts of equal duration at constant acceleration.
    shares = np.arange(count + 1) / count
    parts = (np.arange(1, PARTS_AT_REST) / PARTS_AT_REST) ** 2 / count
    if at_rest[0]:
        shares = np.concatenate([shares[:1], parts, shares[1:]])
    if at_rest[1]:
        shares = np.concatenate([shares[:-1], 1 - parts[::-1], shares[-1:]])
    s = start + (end - start) * shares
    s[-1] = end
    return s


def _match_speeds(lines: list[PaperLine], junctions: list[Junction]) -> None:
    """Reduce the speeds of junctions to speeds that the lines can reach."""
    for number, line in enumerate(lines):
        run = line.forward(junctions[number].speed)
        if run.joint < 0 and run.last_within(line.assigned) == len(line.s) - 1:
            after = junctions[number + 1]
            after.speed = min(after.speed, float(run.speed[-1]))
    for number, line in reversed(list(enumerate(lines))):
        run = line.reverse(junctions[number + 1].speed)
        if run.joint < 0 and run.last_within(line.assigned) == len(line.s) - 1:
            before = junctions[number]
            before.speed = min(before.speed, float(run.speed[-1]))


def _arc_part(name: str, joint_path: JointPath, segment: int, speed: float) -> RulePart:
    """Motion at constant speed along the arc of a rounded corner."""
    path = tool_path_of(joint_path, "paper")
    law = path_law(
        joint_path, path.breaks[segment : segment + 2], np.array([speed]), np.array([speed])
    )
    ends = (float(path.breaks[segment]), float(path.breaks[segment + 1]))
    return RulePart(name, "corner", float(law.breaks[-1]), ends, [law])


def _check_part(part: RulePart, start: float, arm: Arm, limits: Limits) -> LawPhase:
    """Check the limits of a part that starts at the time `start` [s]; returns it with its peaks."""
    # The rules of the method do not include these limits: joint acceleration on the middle part and
    # on corners, joint velocities, torques, and the angular motion of the tool.
    check_limits(
        part.laws,
        arm,
        limits,
        ignored=GUARANTEED,
        location=f"On {part.name} ({part.kind}), between {part.s[0]:.4g} and {part.s[1]:.4g} m "
        "along the path",
        t=start,
        remedy="The method paper does not plan for this limit there: reduce the assigned "
        "velocity or the centripetal acceleration, or plan by the method optimal",
    )
    return LawPhase(
        name=part.name,
        kind=part.kind,
        t=(start, start + part.duration),
        s=part.s,
        **law_peaks(part.laws, arm),
    )


def plan_conventional(joint_path: JointPath, arm: Arm, limits: Limits) -> Trajectory:
    """Plan uniform tool speed from start to end, without regard to the joint limits."""
    # Velocities jump at corners and at both ends. Joint velocity and acceleration are not checked,
    # as in Sec. IV of the paper. Limits of torque and of angular motion are checked between the
    # jumps.
    path = tool_path_of(joint_path, "conventional")
    speeds = np.fmin(path.speeds, require_speed(limits, "conventional"))
    law = path_law(joint_path, path.breaks, speeds, speeds)
    check_limits(
        [law],
        arm,
        limits,
        ignored=IGNORED,
        location="At uniform speed along the path",
        t=0.0,
        remedy="Reduce the assigned velocity, or plan by the method optimal",
    )
    stretch = LawPhase(
        name="whole path",
        kind="uniform",
        t=(0.0, float(law.breaks[-1])),
        s=(0.0, path.length),
        **law_peaks([law], arm),
    )
    return Trajectory(laws=(law,), method=Method.CONVENTIONAL, path=path, stretches=(stretch,))
