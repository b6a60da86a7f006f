"""A JointTrajectory of ROS 2 as YAML, with all points or with those that a tolerance requires."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path as FilePath
from textwrap import indent
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Axes, Duration, Quantity, any_unit, joint_units
from armcontour.core.quintics import evaluate, quintic
from armcontour.core.sampled_data import interpolate
from armcontour.files.exports.export_table import (
    FEWER_DECIMALS,
    SetPointTable,
    event_data,
    fixed_form,
    format_rows,
    write_pieces,
)
from armcontour.motion import Execution

SECOND = 1_000_000_000
# Largest duration in ROS [s]; its seconds are a 32-bit integer.
MAX_DURATION = 2**31 - 1
# Fields of `SetPointTable` by the names of the fields of a JointTrajectoryPoint.
FIELDS = {"positions": "q", "velocities": "dq", "accelerations": "ddq"}
# Number of bisections for the smallest tolerance that a number of points allows.
BISECTIONS = 12
# Smallest tolerance [rad]; encoder errors and a delay of one controller cycle are smaller.
MIN_TOLERANCE = 1e-3
# Minimum time after the last point within which the joints must reach the goal [s].
SETTLING = 0.5
TOLERANCE = "- name: %s\n  position: %.6f\n  velocity: 0.0\n  acceleration: 0.0\n"


@declared()
class GoalTolerances(Checked):
    """Tolerances of a goal of the action FollowJointTrajectory.

    Args:
        path: Largest deviation of each joint from the trajectory during the motion [rad], (dof,).
        goal: Largest deviation of each joint from the last point at the end [rad], (dof,).
        time: Time after the last point within which the joints must reach the goal [s].
    """

    path: Annotated[FloatArray, Quantity("", sign="positive"), Axes("joints")]
    goal: Annotated[FloatArray, Quantity("", sign="positive"), Axes("joints")]
    time: Duration = SETTLING


def predict_tolerances(execution: Execution, factor: float = 2.0) -> GoalTolerances:
    """Return the tolerances of a goal, computed from the predicted joint errors of its set-points.

    Args:
        execution: The predicted motion.
        factor: Ratio of the tolerances to the largest predicted errors. A real arm can exceed the
            predicted errors. No tolerance is below 1 mrad.

    Raises:
        InvalidInput: `factor` is less than 1.
    """
    factor = checks.check_number("factor", factor, "")
    if factor < 1:
        raise InvalidInput(f"factor must be at least 1, but is {factor:g}.", allowed=1.0)
    commands = execution.set_points
    t = execution.t
    errors = np.abs(interpolate(t, commands.t, commands.q) - execution.q)
    late = float(t[-1] - commands.t[-1])
    return GoalTolerances(
        path=np.maximum(factor * errors.max(axis=0), MIN_TOLERANCE),
        goal=np.maximum(factor * errors[-1], MIN_TOLERANCE),
        time=max(2 * late, SETTLING),
    )


def write_ros_yaml(
    table: SetPointTable,
    file: FilePath,
    *,
    tolerances: GoalTolerances | None = None,
) -> None:
    """Write a JointTrajectory message as YAML; with tolerances, a FollowJointTrajectory goal.

    Args:
        table: Points.
        file: File to write.
        tolerances: Tolerances of the goal; None for a message.

    Raises:
        InvalidInput: The tolerances have another number of joints.
    """
    # `ros2 topic pub` accepts the text, which has the form of `ros2 topic echo`. The message has no
    # field for events; each is a comment in JSON at the top, `# event: {...}`.
    fields = {
        name: (getattr(table, x), fixed_form(table.decimals - FEWER_DECIMALS.get(x, 0), table.dof))
        for name, x in FIELDS.items()
    }
    present = {name: x for name, (x, _) in fields.items() if x is not None}
    lines = [f"  {name}: [{x if name in present else ''}]\n" for name, (_, x) in fields.items()]
    lines.append("  effort: []\n")
    point = f"- {''.join(lines).lstrip()}  time_from_start:\n    sec: %d\n    nanosec: %d\n"
    ns = _nanoseconds(table)
    values = np.column_stack([*present.values(), ns // SECOND, ns % SECOND])
    events = "".join(f"# event: {json.dumps(event_data(x))}\n" for x in table.events)
    names = [json.dumps(x, ensure_ascii=False) for x in table.joint_names]
    listed = "".join(f"- {x}\n" for x in names)
    head = (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        f"joint_names:\n{listed}points:\n"
    )
    units = joint_units("rad", table.prismatic)
    named = (f"{x} [{unit}]" for x, unit in zip(table.joint_names, units, strict=True))
    origin = f"# {table.origin}\n" if table.origin else ""
    about = f"# {table.name}\n{origin}# Positions: {', '.join(named)}\n{events}"
    end = list[str]()
    if tolerances is not None:
        about += "trajectory:\n"
        head = indent(head, "  ")
        point = indent(point, "  ")
        if len(tolerances.path) != table.dof:
            raise InvalidInput(
                f"The tolerances have values for {len(tolerances.path)} joints, but {table.name!r} "
                f"has {table.dof} joints."
            )
        for key, values_of in (("path", tolerances.path), ("goal", tolerances.goal)):
            rows = zip(names, values_of, strict=True)
            end += [f"{key}_tolerance:\n", *(TOLERANCE % row for row in rows)]
        ns_late = round(tolerances.time * SECOND)
        end.append(
            f"goal_time_tolerance:\n  sec: {ns_late // SECOND}\n  nanosec: {ns_late % SECOND}\n"
        )
    write_pieces(file, chain([about, head], format_rows(point, values), end))


def select_points(table: SetPointTable, most: int, tolerance: float) -> SetPointTable:
    """Select at most `most` points that a trajectory controller interpolates within a tolerance.

    The controller interpolates by quintics, cubics or lines, depending on the derivatives. Its
    curve through the selected points differs from its curve through all points by at most
    `tolerance` [rad], at the points and between them.

    Raises:
        InvalidInput: More points are necessary.
    """
    if len(table.t) <= most:
        return table
    derivatives = [x for x in (table.q, table.dq, table.ddq) if x is not None]
    t = table.t
    # The controller reads printed numbers.
    printed = [np.round(x, table.decimals - k) for k, x in enumerate(derivatives)]
    rows = _rows_within(t, derivatives, printed, tolerance)
    if len(rows) > most:
        # The smallest tolerance that `most` points keep is between low and high.
        low, high = tolerance, tolerance
        while len(_rows_within(t, derivatives, printed, high)) > most:
            high *= 4
        for _ in range(BISECTIONS):
            middle = (low * high) ** 0.5
            fits = len(_rows_within(t, derivatives, printed, middle)) <= most
            low, high = (low, middle) if fits else (middle, high)
        unit = any_unit("rad", table.prismatic)
        raise InvalidInput(
            f"{most} points of {table.name!r} cannot stay within {tolerance:.3g} {unit} of the "
            f"set-points, which requires {len(rows)} points. {most} points stay within {high:.3g} "
            f"{unit}. Increase points or point_tolerance, or divide the program.",
            needed=high,
            allowed=tolerance,
        )
    return replace(
        table,
        t=t[rows],
        q=table.q[rows],
        dq=None if table.dq is None else table.dq[rows],
        ddq=None if table.ddq is None else table.ddq[rows],
        analog={key: values[rows] for key, values in table.analog.items()},
    )


def _rows_within(
    t: FloatArray,
    derivatives: Sequence[FloatArray],
    printed: Sequence[FloatArray],
    tolerance: float,
) -> IntArray:
    """Select few rows whose interpolation stays within a tolerance of that of all rows, (m,).

    - `t`: times [s], (n,).
    - `derivatives`: joint positions and, if known, velocities and accelerations, (n, dof) each.
    - `printed`: the same, rounded as in the file.
    - `tolerance`: largest difference [rad].
    """
    rows = [0]
    last = len(t) - 1
    while rows[-1] < last:
        start = rows[-1]
        # The farthest row within the tolerance, by doubling until one is beyond it, then bisection.
        within = start + 1
        beyond = last + 1
        while beyond - within > 1:
            if beyond > last:
                row = min(2 * within - start, last)
            else:
                row = (within + beyond) // 2
            if _deviation(t, derivatives, printed, start, row) <= tolerance:
                within = row
            else:
                beyond = row
        rows.append(within)
    return np.array(rows)


def _deviation(
    t: FloatArray, given: Sequence[FloatArray], printed: Sequence[FloatArray], i: int, j: int
) -> float:
    """Bound how far the interpolation from row i to j is from that of all rows [rad]."""
    width = t[j : j + 1] - t[i]
    ends = [[x[k : k + 1] for x in printed] for k in (i, j)]
    slope = (ends[1][0] - ends[0][0]) / width
    if len(given) == 1:
        ends = [[x[0], slope, 0 * slope] for x in ends]
    elif len(given) == 2:
        # Second derivatives of the cubic, with which the quintic is this cubic.
        (_, v), (_, w) = ends
        ends[0].append((6 * slope - 4 * v - 2 * w) / width)
        ends[1].append((2 * v + 4 * w - 6 * slope) / width)
    curve = quintic(width, ends[0], ends[1])[0]
    u = t[i : j + 1] - t[i]
    d = [evaluate(curve, width[0], u, k) - x[i : j + 1] for k, x in enumerate(given)]
    # Between two rows, the difference is a polynomial. Its Bernstein coefficients bound it. They
    # follow from the differences of the derivatives at both rows.
    h = np.diff(u)[:, None]
    degree = 2 * len(given) - 1
    bounds = [d[0]]
    for side, step in ((slice(None, -1), h), (slice(1, None), -h)):
        if len(d) > 1:
            bounds.append(d[0][side] + step * d[1][side] / degree)
        if len(d) > 2:
            curvature = h**2 * d[2][side] / (degree * (degree - 1))
            bounds.append(d[0][side] + 2 * step * d[1][side] / degree + curvature)
    return max(float(np.abs(x).max()) for x in bounds)


def _nanoseconds(table: SetPointTable) -> IntArray:
    """Return the times of the points in whole nanoseconds, (n,)."""
    if table.duration > MAX_DURATION:
        raise InvalidInput(
            f"The motion of {table.name!r} takes {table.duration:g} s, but a duration in ROS is at "
            f"most {MAX_DURATION} s.",
            needed=table.duration,
            allowed=float(MAX_DURATION),
        )
    rounded = np.rint(table.t * 1e9).astype(np.intp)
    if not (np.diff(rounded) > 0).all():
        raise InvalidInput(
            f"The points of {table.name!r} must be at least 1 ns apart, but are nearer."
        )
    return rounded
