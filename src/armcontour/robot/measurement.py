"""Frames of a part and of a tool, measured by touching points with the robot's own tool.

The joint positions of each touch are used, not the coordinates that a pendant shows: the pendant
computes them with the controller's model of the arm, and the job moves by the model of `Arm`.
Errors that both touches and motion share cancel.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, log
from armcontour.core.quantities import Length
from armcontour.core.render import Result
from armcontour.core.result import TABLE, VERDICT, Data, Row
from armcontour.core.text import list_some, short_repr
from armcontour.robot.arm import Arm
from armcontour.robot.measurement_doubts import (
    MAX_LISTED,
    MAX_NOISE_RATIO,
    TURNED,
    Alternative,
    Doubt,
    alternatives_of_points,
    angle_of_z,
    doubt_of_fit,
    doubt_of_touch,
    doubts_of_plan,
    is_planned,
    point_text,
    read_accepted,
    require_accepted,
    rotation_angle,
)
from armcontour.robot.serial import SerialArm
from armcontour.robot.touch_fit import (
    FrameFit,
    fit_frame,
    fitted_scale,
    frame_derivatives,
    leave_one_out,
    unchecked_directions,
    unknowns_of_frame,
)

# Standard deviation of each coordinate of a touch, unless the caller states another one [m].
TOUCH_NOISE = 1e-4
# Largest ratio of the expected error of a part or tool to the noise of a touch.
MAX_AMPLIFICATION = 5.0
# Mistake of a touch that the expected error covers if nothing else would show it, divided by the
# noise of a touch.
MISTAKE_RATIO = 30.0
# Angle below which orientations of the tool count as equal: a wrong tool does not show [rad].
EQUAL_ORIENTATION = np.radians(10.0)
# Ratio of width to length below which touched points count as collinear.
COLLINEAR = 1e-6
# Extent that counts for parts smaller than this [m].
SMALLEST_EXTENT = 0.05
# Change of a touch for the derivatives of a frame of three points [m].
SMALL_CHANGE = 1e-6
# Number of simulated measurements for the expected error.
SIMULATED = 400
# Smallest distance of the origin from the point on the x axis [m].
SMALLEST_STEP = 1e-3
# Smallest number of touches, by the dimension of the arm.
MIN_TOUCHES = {2: 2, 3: 3}
# Poses of the tool that determine its centre point: three unknowns of the tool, three of the point.
MIN_POSES = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measurement(Frozen, Result):
    """A measured frame, the residuals of the touches, and the error to expect.

    Args:
        frame: Measured frame. For a part, it replaces `path.frame` or the work frame; for a tool,
            its position is the tool centre point in the flange frame.
        residuals: Distance of each touch from where the measured frame puts it [m], (n,).
        noise: Standard deviation of each coordinate of a touch [m]: the stated one, or that of the
            residuals if it is larger.
        expected_error: Expected error [m]: for a part, the mean over repeated measurements of the
            largest error on it; for a tool, the root mean square of that of its centre point. With
            unchecked touches, it includes a mistake of 30 times the stated noise at the worst one.
        unchecked: What no redundancy checks: touches, or the tool centre point.
        planned: Frame before the measurement; None if it is unknown.
        doubts: Names of the doubts that were accepted.
    """

    MEASURED: ClassVar[str] = ""
    frame: Frame
    residuals: FloatArray = field(repr=False)
    noise: float
    expected_error: float
    unchecked: tuple[str, ...]
    planned: Frame | None
    doubts: tuple[str, ...]

    def to_data(self) -> Data:
        """Return the frame, its difference from the plan, the errors, and what is not checked."""
        position = [float(x) for x in self.frame.position]
        worst = int(self.residuals.argmax())
        rows = (
            Row("position", position, "m"),
            Row("origin", point_text(self.frame.position, 3), "", "position", level=VERDICT),
            Row("rotation", self.frame.rotation.tolist()),
            *self._difference_rows(),
            Row(
                "expected_error",
                self.expected_error,
                "m",
                "expected error",
                "with a mistake that nothing would show" if self.has_unchecked_touch else "",
                level=VERDICT,
            ),
            Row(
                "unchecked",
                list(self.unchecked) or ["nothing"],
                "",
                "no redundancy for",
                level=VERDICT,
            ),
            Row(
                "residual",
                float(self.residuals[worst]),
                "m",
                "largest residual",
                f"touch {worst + 1}",
                level=VERDICT,
            ),
            Row("noise", self.noise, "m", "noise of a touch", level=TABLE),
            Row("residuals", self.residuals.tolist(), "m"),
        )
        if self.doubts:
            rows += (Row("doubts", list(self.doubts), "", "accepted doubts", level=VERDICT),)
        return Data(f"{self.MEASURED} from {len(self.residuals)} touches", rows)

    @property
    def has_unchecked_touch(self) -> bool:
        """Whether a mistake at a touch could remain unseen, so that the error includes it."""
        return any(x.startswith("touch") for x in self.unchecked)

    def _difference_rows(self) -> tuple[Row, ...]:
        """Return how far the measured frame is from the planned one."""
        if self.planned is None:
            return ()
        shift = self.frame.position - self.planned.position
        return (
            Row("shift", shift.tolist(), "m"),
            Row("moved", point_text(shift, 3), "", "from the plan", level=VERDICT),
        )

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredPart(Measurement):
    """Frame of a part in the work frame, from touched points of the part.

    Args:
        scale: Factor of the drawing that fits the touches best; None without a drawing's points.
    """

    MEASURED = "Part"
    scale: float | None

    def _difference_rows(self) -> tuple[Row, ...]:
        """Return how far the measured frame and the scale are from the planned ones."""
        rows = super(MeasuredPart, self)._difference_rows()
        if self.planned is not None:
            turn = rotation_angle(self.frame.rotation, self.planned.rotation)
            tilt = angle_of_z(self.frame.rotation, self.planned.rotation)
            rows += (
                Row("turn", turn, "rad", "turned from the plan", level=VERDICT),
                Row("tilt", tilt, "rad", "z axis from the plan", level=VERDICT),
            )
        if self.scale is None:
            return rows
        size = f"{(self.scale - 1) * 100:+.2f} %"
        return (
            *rows,
            Row("scale", self.scale, ""),
            Row("size", size, "", "part larger than drawn", level=TABLE),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredTool(Measurement):
    """Centre point of a tool in the flange frame, from poses in which it touches one point.

    Args:
        point: The touched point in the base frame [m], (3,).
    """

    MEASURED = "Tool centre point"
    point: FloatArray


@checked
def measure_part(
    arm: Arm,
    points: npt.ArrayLike | None,
    q: npt.ArrayLike,
    *,
    noise: Length = TOUCH_NOISE,
    region: npt.ArrayLike | None = None,
    planned: Frame | None = None,
    accept: Collection[str] = (),
) -> MeasuredPart:
    """Measure the frame of a part from points of the part that the tool touched.

    The frame (R, t) minimizes the sum of |R x_i + t - p_i|² over the touches, where x_i is a point
    in the drawing's coordinates and p_i the tool position by the model of the arm. The solution is
    that of Kabsch (1976), by a singular value decomposition.

    Without points, three touches are the origin, a point on the x axis, and a point on the side of
    the y axis (three-point method of pendants). Then there are no residuals.

    The expected error is the mean, over simulated measurements with the same points and this noise,
    of the largest error in the region. To first order, the frame has an error of J⁺ times the
    errors of the touches, where J has the rows [I, -[R x_i]×].

    >>> from armcontour.robot.measurement import measure_part
    >>> drawn = [(0.0, 0.0), (0.1, 0.0), (0.0, 0.1)]
    >>> touched = arm.inverse([(0.3, 0.1), (0.4, 0.1), (0.3, 0.2)])
    >>> measure_part(arm, drawn, touched).frame.position.round(6)
    array([0.3, 0.1, 0. ])

    Args:
        arm: Arm with the tool that touches and its work frame.
        points: Points in the coordinates of the drawing [m], (n, dimension); None for the
            three-point method.
        q: Joint positions at the touches [rad], [m] for prismatic joints, (n, dof).
        noise: Standard deviation of each coordinate of a touch [m]. Residuals that are larger
            replace it.
        region: Points of the part where the frame has to be right, such as its path [m],
            (m, dimension); by default the touched points.
        planned: Frame where the part was planned, to which the measured one is compared.
        accept: Names of doubts that are accepted: "turned_over" (the z axis points against the
            planned one), "mirrored", "scaled", "order" (other orders, mirror images or scales of
            the points fit the touches clearly better), "touch" (one touch does not fit the others).

    Raises:
        InvalidInput: There are fewer than three points (two in the plane), the points lie on a
            line or so close together that noise turns the part by more than its contours allow, the
            touches do not fit their points, or a doubt is not accepted: its name is `limit`.
    """
    dimension = arm.dimension
    accepted = read_accepted(accept)
    joints = _read_joints(arm, q)
    touched = arm.tool_position(joints)
    if points is None:
        part = _measure_axes(touched, noise, region, planned, accepted)
        return replace(part, unchecked=(*part.unchecked, *_unchecked_tool(arm, joints)))
    drawn = _read_points("points", points, dimension)
    if len(drawn) != len(touched):
        raise InvalidInput(
            f"Each point has one row of joint positions, but there are {len(drawn)} points and "
            f"{len(touched)} rows."
        )
    if len(drawn) < MIN_TOUCHES[dimension]:
        raise InvalidInput(
            f"A part is measured from {MIN_TOUCHES[dimension]} or more points, but only "
            f"{len(drawn)} are given. Touch more points, far from each other and not on a line."
        )
    needed = drawn if region is None else _read_points("region", region, dimension)
    _require_extent(drawn, needed)
    fit = fit_frame(drawn, touched)
    alternatives = alternatives_of_points(drawn, touched, fit, noise)
    doubts = _doubts_of_points(drawn, touched, fit, noise)
    if planned is not None:
        doubts += doubts_of_plan(fit.rotation, planned, alternatives)
    names = require_accepted(doubts, accepted)
    influence = _influence(drawn, needed)
    amplification = _amplification(influence)
    if amplification > MAX_AMPLIFICATION:
        _refuse_geometry(drawn, needed, amplification, noise)
    residuals = np.linalg.norm(fit.apart, axis=1)
    sigma = _noise_of(fit.apart, noise)
    unseen = unchecked_directions(frame_derivatives(drawn - drawn.mean(axis=0)))
    return MeasuredPart(
        frame=_in_space(fit.rotation, fit.position),
        residuals=checks.frozen_array(residuals),
        noise=sigma,
        expected_error=_with_mistakes(sigma * amplification, influence, noise, unseen, doubts),
        unchecked=(
            *_unchecked_touches(unseen),
            *_unchecked_symmetry(fit, alternatives, planned),
            *_unchecked_tool(arm, joints),
        ),
        planned=planned,
        doubts=names,
        scale=fitted_scale(drawn, touched, fit),
    )


@checked
def measure_tool(
    arm: Arm,
    q: npt.ArrayLike,
    *,
    noise: Length = TOUCH_NOISE,
    planned: Frame | None = None,
    accept: Collection[str] = (),
) -> MeasuredTool:
    """Measure the centre point of a tool that touches one fixed point in several orientations.

    Flange i has the rotation R_i and the position p_i. The centre point t in the flange frame and
    the fixed point c minimize the sum of |R_i t + p_i - c|², which is linear: [R_i, -I] [t; c] =
    -p_i (the pivot method of tool calibration). The covariance is σ² (AᵀA)⁻¹.

    >>> from armcontour.robot.measurement import measure_tool
    >>> ur5e = ac.load_arm("ur5e").with_tool((0.0, 0.02, 0.15))
    >>> turned = Rotation.from_euler("xyz", [[3, 0, 0], [3, 0.6, 0], [3, 0, 2], [2.5, 0, 1]])
    >>> touching = [ac.Frame((0.4, 0.0, 0.2), x) for x in turned]
    >>> q = [ur5e.inverse(pose) for pose in touching]
    >>> measure_tool(ur5e, q).frame.position.round(6)
    array([0.  , 0.02, 0.15])

    Args:
        arm: Arm in space; its tool is ignored.
        q: Joint positions of the poses [rad], [m] for prismatic joints, (n, dof).
        noise: Standard deviation of each coordinate of a touch [m]. Residuals that are larger
            replace it.
        planned: Tool frame before the measurement, to which the centre point is compared.
        accept: Names of doubts that are accepted: "turned_over" (the tool points to the other side
            of the flange than planned), "touch" (one pose does not fit the others).

    Raises:
        InvalidInput: The arm is planar, there are fewer than three poses, the tool has nearly the
            same orientation in all of them, the poses do not touch one point, or a doubt is not
            accepted: its name is `limit`.
    """
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The planar arm {arm.name} has no tool frame to measure. Its second link ends at the "
            "tool centre point."
        )
    accepted = read_accepted(accept)
    joints = _read_joints(arm, q)
    if len(joints) < MIN_POSES:
        raise InvalidInput(
            f"A tool is measured from {MIN_POSES} or more poses, but only {len(joints)} are given. "
            "Touch the same point in more orientations, each tilted by 30 deg or more."
        )
    flange = arm.from_floor.with_tool(Frame()).with_work(Frame())
    positions, rotations = flange.pose(joints[:, arm.dof - flange.dof :])
    pivot = _solve_pivot(rotations, positions)
    _require_turns(rotations, pivot.matrix)
    doubts = _doubts_of_poses(rotations, positions, pivot, noise)
    if planned is not None and pivot.tool @ planned.position < 0.0:
        doubts.append(_tool_on_other_side(pivot.tool, planned))
    names = require_accepted(doubts, accepted)
    residuals = np.linalg.norm(pivot.apart, axis=1)
    sigma = _noise_of(pivot.apart, noise)
    influence = np.asarray(np.linalg.pinv(pivot.matrix)[:3].reshape(1, 3, len(joints), 3))
    unseen = unchecked_directions(pivot.matrix.reshape(-1, 3, 6))
    # The root mean square of J⁺ times noise is σ times the root of the trace of (AᵀA)⁻¹.
    from_noise = sigma * float(np.linalg.norm(influence))
    return MeasuredTool(
        frame=Frame(position=pivot.tool),
        point=checks.frozen_array(pivot.point),
        residuals=checks.frozen_array(residuals),
        noise=sigma,
        expected_error=_with_mistakes(from_noise, influence, noise, unseen, doubts),
        unchecked=_unchecked_touches(unseen),
        planned=planned,
        doubts=names,
    )


def _doubts_of_points(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> list[Doubt]:
    """Return the mistake that the residuals show; refuse residuals that no mistake explains."""
    doubt = doubt_of_fit(drawn, touched, fit, noise)
    if doubt is not None:
        return [doubt]
    sigma = _noise_of(fit.apart, noise)
    if sigma <= MAX_NOISE_RATIO * noise:
        return []
    drawn_distances = np.linalg.norm(drawn[:, None] - drawn, axis=-1)
    touched_distances = np.linalg.norm(touched[:, None] - touched, axis=-1)
    difference = np.abs(drawn_distances - touched_distances)
    first, second = np.unravel_index(int(difference.argmax()), difference.shape)
    raise InvalidInput(
        f"The touches do not fit their points: residuals show a noise of {sigma * 1e3:.3g} mm, at "
        f"most {MAX_NOISE_RATIO * noise * 1e3:.3g} mm are allowed. Points {first + 1} and "
        f"{second + 1} are {drawn_distances[first, second] * 1e3:.4g} mm apart in the drawing, but "
        f"{touched_distances[first, second] * 1e3:.4g} mm where they were touched. Check the order "
        "of the rows, the units and the tool of the arm, or state the noise of the touches.",
        needed=sigma,
        allowed=MAX_NOISE_RATIO * noise,
    )


def _doubts_of_poses(
    rotations: FloatArray, positions: FloatArray, pivot: _Pivot, noise: float
) -> list[Doubt]:
    """Return the pose that does not fit the others; refuse poses that do not touch one point."""
    squares = float((pivot.apart**2).sum())
    count = len(positions)
    if count > MIN_POSES:
        left_out = leave_one_out(lambda keep: _apart_by(rotations, positions, keep), count)
        doubt = doubt_of_touch(squares, left_out, noise, ["the touched point"] * count)
        if doubt is not None:
            return [doubt]
    sigma = _noise_of(pivot.apart, noise)
    if sigma <= MAX_NOISE_RATIO * noise:
        return []
    raise InvalidInput(
        f"The poses do not touch one point: residuals show a noise of {sigma * 1e3:.3g} mm, at "
        f"most {MAX_NOISE_RATIO * noise * 1e3:.3g} mm are allowed. Check the joint positions, or "
        "state the noise of the touches.",
        needed=sigma,
        allowed=MAX_NOISE_RATIO * noise,
    )


def _tool_on_other_side(tool: FloatArray, planned: Frame) -> Doubt:
    """Return the doubt about a tool that points to the other side of the flange."""
    reason = (
        f"The measured tool centre point {point_text(tool)} is on the other side of the flange "
        f"than the planned one, {point_text(planned.position)}. Check the signs of the joint "
        "positions and the planned tool."
    )
    return Doubt(name="turned_over", reason=reason)


def _unchecked_touches(unseen: FloatArray) -> tuple[str, ...]:
    """Return the touches whose mistakes the others would not show."""
    rows = [str(i + 1) for i in np.flatnonzero(np.abs(unseen).max(axis=(1, 2)) > 0.0)]
    if not rows:
        return ()
    listed = list_some(rows, MAX_LISTED)
    return (f"touch {listed}" if len(rows) == 1 else f"touches {listed}",)


def _unchecked_symmetry(
    fit: FrameFit, alternatives: Sequence[Alternative], planned: Frame | None
) -> tuple[str, ...]:
    """Return what neither the touches nor a planned frame tell about a symmetric drawing."""
    if is_planned(planned):
        return ()
    others = [x for x in alternatives if rotation_angle(x.rotation, fit.rotation) > TURNED]
    if planned is not None:
        others = [x for x in others if len(x.rotation) == 2 or x.rotation[2, 2] > 0.0]
    unknown = []
    if any(x.is_order for x in others):
        unknown.append("the order of the points")
    if not all(x.is_order for x in others):
        unknown.append("mirrored points")
    return tuple(unknown)


def _unchecked_tool(arm: Arm, joints: FloatArray) -> tuple[str, ...]:
    """Return whether the touches would show a wrong tool centre point.

    With equal orientations, a wrong centre point moves all touches alike.
    """
    if not isinstance(arm, SerialArm):
        return ()
    rotations = arm.pose(joints)[1]
    turned = np.linalg.norm(log(rotations[0].T @ rotations), axis=-1)
    return ("the tool centre point",) if turned.max() < EQUAL_ORIENTATION else ()


class _Pivot(NamedTuple):
    """Solution of the pivot method."""

    matrix: FloatArray  # Coefficients of tool and point, (3 n, 6)
    tool: FloatArray  # Tool centre point in the flange frame [m], (3,)
    point: FloatArray  # Touched point in the base frame [m], (3,)
    apart: FloatArray  # Tool minus touched point [m], (n, 3)


def _read_points(name: str, points: npt.ArrayLike, dimension: int) -> FloatArray:
    """Read points of the drawing, (n, dimension); for a planar arm, z is dropped."""
    values = checks.points(name, points)
    if dimension == 3 and values.shape[1] == 2:
        return np.column_stack([values, np.zeros(len(values))])
    return values[:, :dimension]


def _measure_axes(
    touched: FloatArray,
    noise: float,
    region: npt.ArrayLike | None,
    planned: Frame | None,
    accepted: Collection[str],
) -> MeasuredPart:
    """Measure the frame of a part by the three-point method."""
    count, dimension = touched.shape
    if count != 3:
        raise InvalidInput(
            f"Without points, a part has three touches: the origin, a point on the x axis, and a "
            f"point on the side of the y axis. {count} are given. Add the coordinates x, y and z "
            "of each touched point in the drawing, or remove touches."
        )
    if _is_on_line(touched) or np.linalg.norm(touched[1] - touched[0]) < SMALLEST_STEP:
        raise InvalidInput(
            "The three touches lie on a line or at one place. Touch the origin, a point on the x "
            "axis, and a point beside this axis, far from each other."
        )
    frame = _frame_of_axes(touched)
    rotation = frame.rotation[:dimension, :dimension]
    doubts = []
    if planned is not None:
        doubts = doubts_of_plan(rotation, planned, _alternatives_of_axes(touched, rotation))
    names = require_accepted(doubts, accepted)
    drawn = (touched - frame.position[:dimension]) @ rotation
    needed = drawn if region is None else _read_points("region", region, dimension)
    influence = _influence_of_axes(touched, frame, needed)
    amplification = _amplification(influence)
    if amplification > MAX_AMPLIFICATION:
        farther = amplification / MAX_AMPLIFICATION
        raise InvalidInput(
            f"The three touches are too close together for the part: noise of {noise * 1e3:.3g} mm "
            f"per touch causes an error of {amplification * noise * 1e3:.3g} mm, at most "
            f"{MAX_AMPLIFICATION * noise * 1e3:.3g} mm are allowed. Touch the x axis and the side "
            f"of y {farther:.2g} times as far from the origin or farther.",
            needed=amplification * noise,
            allowed=MAX_AMPLIFICATION * noise,
        )
    # There are as many unknowns as coordinates that count, so nothing checks a touch.
    unseen: FloatArray = np.stack([np.eye(dimension)] * 3)
    return MeasuredPart(
        frame=frame,
        residuals=checks.frozen_array(np.zeros(3)),
        noise=noise,
        expected_error=_with_mistakes(noise * amplification, influence, noise, unseen, doubts),
        unchecked=_unchecked_touches(unseen),
        planned=planned,
        doubts=names,
        scale=None,
    )


def _alternatives_of_axes(touched: FloatArray, rotation: FloatArray) -> list[Alternative]:
    """Return the rotations with the three touches in another order, or y on the other side."""
    dimension = len(rotation)
    signs = np.array([1.0, -1.0, -1.0])[:dimension]
    found = [
        Alternative(
            correction="with the third touch on the other side of the x axis",
            rotation=rotation * signs,
            is_order=False,
        )
    ]
    for order in list(permutations(range(3)))[1:]:
        frame = _frame_of_axes(touched[list(order)])
        listed = ", ".join(str(i + 1) for i in order)
        found.append(
            Alternative(
                correction=f"with the touches in the order {listed}",
                rotation=frame.rotation[:dimension, :dimension],
                is_order=True,
            )
        )
    return found


def _influence_of_axes(touched: FloatArray, frame: Frame, needed: FloatArray) -> FloatArray:
    """Return derivatives of needed points by three touches, by differences, (m, d, 3, d)."""
    count, dimension = touched.shape
    influence = np.empty((len(needed), dimension, count, dimension))
    for touch, axis in np.ndindex(count, dimension):
        changed = touched.copy()
        changed[touch, axis] += SMALL_CHANGE
        other = _frame_of_axes(changed)
        turned = (other.rotation - frame.rotation)[:dimension, :dimension]
        shift = (other.position - frame.position)[:dimension]
        influence[:, :, touch, axis] = (needed @ turned.T + shift) / SMALL_CHANGE
    return influence


def _frame_of_axes(touched: FloatArray) -> Frame:
    """Return the frame with an origin, a point on its x axis and a point on the side of y."""
    if touched.shape[1] == 2:
        touched = np.column_stack([touched, np.zeros(3)])
    origin, on_x, beside = touched
    x = (on_x - origin) / np.linalg.norm(on_x - origin)
    normal = np.cross(x, beside - origin)
    z = normal / np.linalg.norm(normal)
    return Frame(position=origin, rotation=np.column_stack([x, np.cross(z, x), z]))


def _read_joints(arm: Arm, q: npt.ArrayLike) -> FloatArray:
    """Read joint positions, (n, dof)."""
    joints = checks.check_numbers("joint positions", q, "rad")
    if joints.ndim != 2 or joints.shape[1] != arm.dof:
        raise InvalidInput(
            f"The joint positions must have one row per touch and one column for each of the "
            f"{arm.dof} joints of {arm.name}, but have the shape {joints.shape}."
        )
    return joints


def _in_space(rotation: FloatArray, position: FloatArray) -> Frame:
    """Return the frame in space; for a planar arm, a rotation about z."""
    if len(position) == 3:
        return Frame(position=position, rotation=rotation)
    turned = np.eye(3)
    turned[:2, :2] = rotation
    return Frame(position=np.append(position, 0.0), rotation=turned)


def _influence(drawn: FloatArray, needed: FloatArray) -> FloatArray:
    """Return derivatives of needed points by the touches, (m, d, n, d).

    The linearized frame has an error of the pseudoinverse of J times the errors of the touches.
    """
    count, dimension = drawn.shape
    centre = drawn.mean(axis=0)
    rows = frame_derivatives(drawn - centre).reshape(-1, unknowns_of_frame(dimension))
    influence = frame_derivatives(needed - centre) @ np.linalg.pinv(rows)
    return np.asarray(influence.reshape(len(needed), dimension, count, dimension))


def _simulated_errors(influence: FloatArray) -> FloatArray:
    """Return errors at needed points in measurements with touches of unit noise, (samples, m)."""
    # A fixed seed: the same touches always have the same expected error.
    noise = np.random.default_rng(0).standard_normal((SIMULATED, *influence.shape[2:]))
    errors = np.einsum("mdik,sik->smd", influence, noise, optimize=True)
    return np.asarray(np.linalg.norm(errors, axis=2))


def _amplification(influence: FloatArray) -> float:
    """Return the expected largest error at needed points, divided by the noise of a touch."""
    return float(_simulated_errors(influence).max(axis=1).mean())


def _with_mistakes(
    from_noise: float,
    influence: FloatArray,
    noise: float,
    unseen: FloatArray,
    doubts: Sequence[Doubt],
) -> float:
    """Return the expected error with the largest mistake that is unseen or accepted [m].

    Args:
        from_noise: Expected error without mistakes [m].
        influence: Derivatives of needed points by the touches, (m, d, n, d).
        noise: Stated standard deviation of each coordinate of a touch [m].
        unseen: Projections on directions in which nothing checks a touch, (n, d, d).
        doubts: Accepted doubts.
    """
    moved = np.einsum("mdik,ikl->midl", influence, unseen)
    mistake = float(np.linalg.norm(moved, ord=2, axis=(2, 3)).max()) * MISTAKE_RATIO * noise
    for doubt in doubts:
        if doubt.index is not None and doubt.mistake is not None:
            by_touch = influence[:, :, doubt.index] @ doubt.mistake
            mistake = max(mistake, float(np.linalg.norm(by_touch, axis=1).max()))
    return float(np.hypot(from_noise, mistake))


def _noise_of(apart: FloatArray, noise: float) -> float:
    """Return the stated noise of a touch, or that of the residuals if it is larger [m].

    Args:
        apart: Residuals of the touches [m], (n, dimension). A frame has as many unknowns as a tool
            with the touched point.
        noise: Stated standard deviation of each coordinate [m].
    """
    freedom = apart.size - unknowns_of_frame(apart.shape[1])
    if freedom <= 0:
        return noise
    return max(noise, float(np.sqrt((apart**2).sum() / freedom)))


def _require_extent(drawn: FloatArray, needed: FloatArray) -> None:
    """Refuse points that coincide or lie exactly on a line."""
    if not _is_on_line(drawn):
        return
    extent = float(np.ptp(drawn, axis=0).max())
    where = "at one place" if extent < 1e-6 else "on a line"
    raise InvalidInput(
        f"The touched points lie {where}, so that they do not determine the rotation of the part. "
        f"Also touch a point near {point_text(_best_addition(drawn, needed))}.",
        needed=extent,
    )


def _best_addition(drawn: FloatArray, needed: FloatArray) -> FloatArray:
    """Return the point that, if it is touched as well, reduces the expected error most.

    It is a point of the region or a corner of its box. If none of them makes the error small
    enough, for example because the whole region lies on a line, it is a point beside the region.
    """
    low = needed.min(axis=0)
    high = needed.max(axis=0)
    extent = float(max(np.ptp(np.concatenate([drawn, needed]), axis=0).max(), SMALLEST_EXTENT))

    # Of points that leave the rotation undetermined, the farthest from the touches is best.
    def rank(point: FloatArray) -> tuple[float, float]:
        distance = float(np.linalg.norm(drawn - point, axis=1).min())
        return _worst_error_with(drawn, point, needed), -distance

    found = min(np.concatenate([needed, _grid_points(low, high)]), key=rank)
    if rank(found)[0] > MAX_AMPLIFICATION:
        beside = min(_grid_points(low, high + extent), key=rank)
        if rank(beside) < rank(found):
            found = beside
    return np.asarray(found)


def _grid_points(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the corners of a box, (2^dimension, dimension)."""
    sides = np.stack([low, high])
    corners = np.stack(np.meshgrid(*sides.T, indexing="ij"), axis=-1)
    return np.asarray(corners.reshape(-1, len(low)))


def _worst_error_with(drawn: FloatArray, addition: FloatArray, needed: FloatArray) -> float:
    """Return the largest error per noise if one more point is touched; infinite on a line."""
    touched = np.concatenate([drawn, addition[None]])
    if _is_on_line(touched):
        return np.inf
    return _amplification(_influence(touched, needed))


def _is_on_line(points: FloatArray) -> bool:
    """Return whether points lie on a line; in the plane, whether they coincide."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    extent = max(float(np.ptp(points, axis=0).max()), SMALLEST_EXTENT)
    return bool(spread[points.shape[1] - 2] <= COLLINEAR * extent)


def _refuse_geometry(
    drawn: FloatArray, needed: FloatArray, amplification: float, noise: float
) -> None:
    """Refuse touches whose noise causes too large an error somewhere on the part."""
    addition = _best_addition(drawn, needed)
    more = np.concatenate([drawn, addition[None]])
    after = _amplification(_influence(more, needed))
    worst = int(_simulated_errors(_influence(drawn, needed)).mean(axis=0).argmax())
    raise InvalidInput(
        f"The touched points are too close together or too near to a line: noise of "
        f"{noise * 1e3:.3g} mm per touch causes an error of {amplification * noise * 1e3:.3g} mm "
        f"at {point_text(needed[worst])}, at most {MAX_AMPLIFICATION * noise * 1e3:.3g} mm are "
        f"allowed. Also touch a point near {point_text(addition)}, which reduces it to "
        f"{after * noise * 1e3:.3g} mm.",
        needed=amplification * noise,
        allowed=MAX_AMPLIFICATION * noise,
    )


def _solve_pivot(rotations: FloatArray, positions: FloatArray) -> _Pivot:
    """Solve [R_i, -I] [t; c] = -p_i for the tool centre point t and the touched point c."""
    unit = np.broadcast_to(-np.eye(3), rotations.shape)
    matrix = np.concatenate([rotations, unit], axis=2).reshape(-1, 6)
    right = -positions.reshape(-1)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    apart = (matrix @ solution - right).reshape(-1, 3)
    return _Pivot(matrix, solution[:3], solution[3:], apart)


def _apart_by(rotations: FloatArray, positions: FloatArray, keep: BoolArray) -> FloatArray:
    """Return tool minus touched point of all poses, by the tool of some poses [m], (n, 3)."""
    pivot = _solve_pivot(rotations[keep], positions[keep])
    return rotations @ pivot.tool + positions - pivot.point


def _require_turns(rotations: FloatArray, matrix: FloatArray) -> None:
    """Refuse poses in which the tool has nearly the same orientation, or turns about one axis."""
    # A singular value is the factor from an error of tool and point to the touches.
    if np.linalg.svd(matrix, compute_uv=False)[-1] * MAX_AMPLIFICATION >= 1.0:
        return
    relative = log(rotations[0].T @ rotations)
    largest = np.degrees(np.linalg.norm(relative, axis=1).max())
    axis = np.linalg.svd(relative)[2][0]
    name = "xyz"[int(np.abs(axis).argmax())]
    others = " and ".join(x for x in "xyz" if x != name)
    raise InvalidInput(
        f"The orientations of the tool differ too little, or only about one axis: by up to "
        f"{largest:.3g} deg, mainly about the flange's {name} axis. Noise would be multiplied by "
        f"more than {MAX_AMPLIFICATION:g}. Also touch the point with the tool tilted by 40 deg or "
        f"more about the flange's {others} axes.",
        needed=float(np.radians(largest)),
    )
