"""Frames of a part and of a tool, measured by touching points with the robot's own tool.

The joint positions of each touch are used, not the coordinates that a pendant shows: the pendant
computes them with the controller's model of the arm, and the job moves by the model of `Arm`.
Errors that both touches and motion share cancel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.frames import Frame, log
from armcontour.core.quantities import Length
from armcontour.core.render import Result
from armcontour.core.result import TABLE, VERDICT, Data, Row
from armcontour.core.text import short_repr
from armcontour.robot.arm import Arm
from armcontour.robot.serial import SerialArm

# Standard deviation of each coordinate of a touch, unless the caller states another one [m].
TOUCH_NOISE = 1e-4
# Largest ratio of the expected error of a part or tool to the noise of a touch.
MAX_AMPLIFICATION = 5.0
# Largest ratio of residuals to the noise of a touch. Larger residuals are mistakes, not noise.
MAX_RESIDUAL_RATIO = 10.0
# Residuals below this are accepted whatever the stated noise is [m].
ACCEPTED_RESIDUAL = 2e-3
# Ratio of width to length below which touched points count as collinear.
COLLINEAR = 1e-6
# Extent that counts for parts smaller than this [m].
SMALLEST_EXTENT = 0.05
# Noise of simulated touches of three points [m]; it is small, so that errors are linear in it.
SIMULATED_NOISE = 1e-6
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
    """A measured frame, the residuals of the touches, and the error that their noise causes.

    Args:
        frame: Measured frame. For a part, it replaces `path.frame` or the work frame; for a tool,
            its position is the tool centre point in the flange frame.
        residuals: Distance of each touch from where the measured frame puts it [m], (n,).
        noise: Standard deviation of each coordinate of a touch [m]: the stated one, or that of the
            residuals if it is larger.
        expected_error: Expected error [m]: for a part, the mean over repeated measurements of the
            largest error on it; for a tool, the root mean square of that of its centre point.
    """

    MEASURED: ClassVar[str] = ""
    frame: Frame
    residuals: FloatArray = field(repr=False)
    noise: float
    expected_error: float

    def to_data(self) -> Data:
        """Return the frame, the expected error, and the residual of each touch."""
        position = [float(x) for x in self.frame.position]
        shown = ", ".join(f"{x * 1e3:z.3f}" for x in position)
        worst = int(self.residuals.argmax())
        rows = (
            Row("position", position, "m"),
            Row("origin", f"({shown}) mm", "", "position", level=VERDICT),
            Row("rotation", self.frame.rotation.tolist()),
            Row("expected_error", self.expected_error, "m", "expected error", level=VERDICT),
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
        return Data(f"{self.MEASURED} from {len(self.residuals)} touches", rows)

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredPart(Measurement):
    """Frame of a part in the work frame, from touched points of the part."""

    MEASURED = "Part"


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

    Raises:
        InvalidInput: There are fewer than three points (two in the plane), the points lie on a
            line or so close together that noise turns the part by more than its contours allow, or
            a touch does not fit its point.
    """
    dimension = arm.dimension
    touched = arm.tool_position(_read_joints(arm, q))
    if points is None:
        return _measure_axes(touched, noise, region)
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
    rotation, position = _fit_frame(drawn, touched)
    residuals = np.linalg.norm(drawn @ rotation.T + position - touched, axis=1)
    sigma = _noise_of(residuals, len(drawn) * dimension - _unknowns(dimension), noise)
    _require_fit(drawn, touched, residuals, noise)
    amplification = _error_amplification(drawn, needed)
    if amplification > MAX_AMPLIFICATION:
        _refuse_geometry(drawn, needed, amplification, noise)
    return MeasuredPart(
        frame=_in_space(rotation, position),
        residuals=checks.frozen_array(residuals),
        noise=sigma,
        expected_error=sigma * amplification,
    )


@checked
def measure_tool(arm: Arm, q: npt.ArrayLike, *, noise: Length = TOUCH_NOISE) -> MeasuredTool:
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

    Raises:
        InvalidInput: The arm is planar, there are fewer than three poses, the tool has nearly the
            same orientation in all of them, or a pose does not fit the others.
    """
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The planar arm {arm.name} has no tool frame to measure. Its second link ends at the "
            "tool centre point."
        )
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
    _require_poses_fit(rotations, positions, noise)
    sigma = _noise_of(pivot.residuals, 3 * len(joints) - 6, noise)
    covariance = np.linalg.inv(pivot.matrix.T @ pivot.matrix)
    return MeasuredTool(
        frame=Frame(position=pivot.tool),
        point=checks.frozen_array(pivot.point),
        residuals=checks.frozen_array(pivot.residuals),
        noise=sigma,
        expected_error=sigma * float(np.sqrt(np.trace(covariance[:3, :3]))),
    )


class _Pivot(NamedTuple):
    """Solution of the pivot method."""

    matrix: FloatArray  # Coefficients of tool and point, (3 n, 6)
    tool: FloatArray  # Tool centre point in the flange frame [m], (3,)
    point: FloatArray  # Touched point in the base frame [m], (3,)
    residuals: FloatArray  # Distance of each touch from the point [m], (n,)


def _read_points(name: str, points: npt.ArrayLike, dimension: int) -> FloatArray:
    """Read points of the drawing, (n, dimension); for a planar arm, z is dropped."""
    values = checks.points(name, points)
    if dimension == 3 and values.shape[1] == 2:
        return np.column_stack([values, np.zeros(len(values))])
    return values[:, :dimension]


def _measure_axes(touched: FloatArray, noise: float, region: npt.ArrayLike | None) -> MeasuredPart:
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
    drawn = (touched - frame.position[:dimension]) @ frame.rotation[:dimension, :dimension]
    needed = drawn if region is None else _read_points("region", region, dimension)
    random = np.random.default_rng(0)
    largest = []
    for _ in range(SIMULATED):
        noise_of_touches = random.standard_normal(touched.shape) * SIMULATED_NOISE
        simulated = _frame_of_axes(touched + noise_of_touches)
        shift = simulated.position - frame.position
        turned = (simulated.rotation - frame.rotation)[:dimension, :dimension]
        errors = needed @ turned.T + shift[:dimension]
        largest.append(np.linalg.norm(errors, axis=1).max() * (1 / SIMULATED_NOISE))
    amplification = float(np.mean(largest))
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
    return MeasuredPart(
        frame=frame,
        residuals=checks.frozen_array(np.zeros(3)),
        noise=noise,
        expected_error=noise * amplification,
    )


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


def _unknowns(dimension: int) -> int:
    """Return the number of unknowns of a frame: its position and its rotation."""
    return 3 if dimension == 2 else 6


def _fit_frame(drawn: FloatArray, touched: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation and the position that map drawn to touched points best (Kabsch)."""
    drawn_centre = drawn.mean(axis=0)
    touched_centre = touched.mean(axis=0)
    left, _, right = np.linalg.svd((drawn - drawn_centre).T @ (touched - touched_centre))
    # The factor -1 on the weakest direction turns a reflection into the nearest rotation.
    signs = np.ones(drawn.shape[1])
    signs[-1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = right.T @ (signs[:, None] * left.T)
    return rotation, touched_centre - rotation @ drawn_centre


def _in_space(rotation: FloatArray, position: FloatArray) -> Frame:
    """Return the frame in space; for a planar arm, a rotation about z."""
    if len(position) == 3:
        return Frame(position=position, rotation=rotation)
    turned = np.eye(3)
    turned[:2, :2] = rotation
    return Frame(position=np.append(position, 0.0), rotation=turned)


def _jacobian(points: FloatArray) -> FloatArray:
    """Return the derivatives of points by a frame's unknowns, (n, dimension, unknowns)."""
    count, dimension = points.shape
    jacobian = np.zeros((count, dimension, _unknowns(dimension)))
    jacobian[:, :, :dimension] = np.eye(dimension)
    if dimension == 2:
        jacobian[:, 0, 2] = -points[:, 1]
        jacobian[:, 1, 2] = points[:, 0]
        return jacobian
    for axis in range(3):
        jacobian[:, :, 3 + axis] = np.cross(np.eye(3)[axis], points)
    return jacobian


def _simulated_errors(drawn: FloatArray, needed: FloatArray) -> FloatArray:
    """Return errors at needed points in measurements with touches of unit noise, (samples, m).

    Measurements are simulated with the linearized frame: its error is the pseudoinverse of J times
    the errors of the touches.
    """
    centre = drawn.mean(axis=0)
    rows = _jacobian(drawn - centre).reshape(-1, _unknowns(drawn.shape[1]))
    at_needed = _jacobian(needed - centre) @ np.linalg.pinv(rows)
    # A fixed seed: the same touches always have the same expected error.
    noise = np.random.default_rng(0).standard_normal((SIMULATED, drawn.size))
    errors = np.einsum("mdk,sk->smd", at_needed, noise)
    return np.asarray(np.linalg.norm(errors, axis=2))


def _error_amplification(drawn: FloatArray, needed: FloatArray) -> float:
    """Return the expected largest error at needed points, divided by the noise of a touch."""
    return float(_simulated_errors(drawn, needed).max(axis=1).mean())


def _noise_of(residuals: FloatArray, freedom: int, noise: float) -> float:
    """Return the stated noise of a touch, or that of the residuals if it is larger [m]."""
    if freedom <= 0:
        return noise
    return max(noise, float(np.sqrt((residuals**2).sum() / freedom)))


def _require_extent(drawn: FloatArray, needed: FloatArray) -> None:
    """Refuse points that coincide or lie exactly on a line."""
    if not _is_on_line(drawn):
        return
    extent = float(np.ptp(drawn, axis=0).max())
    where = "at one place" if extent < 1e-6 else "on a line"
    raise InvalidInput(
        f"The touched points lie {where}, so that they do not determine the rotation of the part. "
        f"Also touch a point near {_written(_best_addition(drawn, needed))}.",
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
    return _error_amplification(touched, needed)


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
    after = _error_amplification(more, needed)
    worst = int(_simulated_errors(drawn, needed).mean(axis=0).argmax())
    raise InvalidInput(
        f"The touched points are too close together or too near to a line: noise of "
        f"{noise * 1e3:.3g} mm per touch causes an error of {amplification * noise * 1e3:.3g} mm "
        f"at {_written(needed[worst])}, at most {MAX_AMPLIFICATION * noise * 1e3:.3g} mm are "
        f"allowed. Also touch a point near {_written(addition)}, which reduces it to "
        f"{after * noise * 1e3:.3g} mm.",
        needed=amplification * noise,
        allowed=MAX_AMPLIFICATION * noise,
    )


def _require_fit(
    drawn: FloatArray, touched: FloatArray, residuals: FloatArray, noise: float
) -> None:
    """Refuse a touch that does not fit its point, such as a swapped or mistyped one."""
    allowed = max(MAX_RESIDUAL_RATIO * noise, ACCEPTED_RESIDUAL)
    if residuals.max() <= allowed:
        return
    if len(drawn) > MIN_TOUCHES[drawn.shape[1]]:
        # The touch whose omission leaves the smallest residuals is the mistaken one, if the others
        # then fit. The largest residual alone is misleading, because a mistake bends the fit.
        others = np.array([_residual_without(drawn, touched, i) for i in range(len(drawn))])
        mistaken = int(others.argmin())
        if others[mistaken] <= allowed:
            raise InvalidInput(
                f"Touch {mistaken + 1} does not fit its point {_written(drawn[mistaken])}: without "
                f"it the residuals are at most {others[mistaken] * 1e3:.3g} mm, with it "
                f"{residuals.max() * 1e3:.3g} mm, at most {allowed * 1e3:.3g} mm are allowed. "
                "Correct its coordinates, or touch it again.",
                index=mistaken,
                needed=float(residuals.max()),
                allowed=allowed,
            )
    drawn_distances = np.linalg.norm(drawn[:, None] - drawn, axis=-1)
    touched_distances = np.linalg.norm(touched[:, None] - touched, axis=-1)
    difference = np.abs(drawn_distances - touched_distances)
    first, second = np.unravel_index(int(difference.argmax()), difference.shape)
    raise InvalidInput(
        f"The touches do not fit their points: residuals are up to {residuals.max() * 1e3:.3g} mm, "
        f"at most {allowed * 1e3:.3g} mm are allowed. Points {first + 1} and {second + 1} are "
        f"{drawn_distances[first, second] * 1e3:.4g} mm apart in the drawing, but "
        f"{touched_distances[first, second] * 1e3:.4g} mm where they were touched. Check the order "
        "of the rows, the units and the tool of the arm.",
        needed=float(residuals.max()),
        allowed=allowed,
    )


def _residual_without(drawn: FloatArray, touched: FloatArray, omitted: int) -> float:
    """Return the largest residual of a fit without one touch [m]."""
    keep = np.arange(len(drawn)) != omitted
    rotation, position = _fit_frame(drawn[keep], touched[keep])
    apart = drawn[keep] @ rotation.T + position - touched[keep]
    return float(np.linalg.norm(apart, axis=1).max())


def _written(point: FloatArray) -> str:
    """Write a point in mm, such as "(40, 20, 0) mm"."""
    return f"({', '.join(f'{x * 1e3:z.4g}' for x in point)}) mm"


def _solve_pivot(rotations: FloatArray, positions: FloatArray) -> _Pivot:
    """Solve [R_i, -I] [t; c] = -p_i for the tool centre point t and the touched point c."""
    unit = np.broadcast_to(-np.eye(3), rotations.shape)
    matrix = np.concatenate([rotations, unit], axis=2).reshape(-1, 6)
    right = -positions.reshape(-1)
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    residuals = np.linalg.norm((matrix @ solution - right).reshape(-1, 3), axis=1)
    return _Pivot(matrix, solution[:3], solution[3:], residuals)


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


def _require_poses_fit(rotations: FloatArray, positions: FloatArray, noise: float) -> None:
    """Refuse a pose in which the tool did not touch the same point as in the others."""
    residuals = _solve_pivot(rotations, positions).residuals
    allowed = max(MAX_RESIDUAL_RATIO * noise, ACCEPTED_RESIDUAL)
    if residuals.max() <= allowed:
        return
    mistaken = int(residuals.argmax())
    if len(positions) > MIN_POSES:
        others = np.arange(len(positions))
        without = [
            _solve_pivot(rotations[others != i], positions[others != i]).residuals.max()
            for i in others
        ]
        mistaken = int(np.argmin(without))
    raise InvalidInput(
        f"The poses do not touch one point: residuals are up to {residuals.max() * 1e3:.3g} mm, at "
        f"most {allowed * 1e3:.3g} mm are allowed. Pose {mistaken + 1} differs most from the "
        "others. Record it again, or check the joint positions of its row.",
        index=mistaken,
        needed=float(residuals.max()),
        allowed=allowed,
    )
