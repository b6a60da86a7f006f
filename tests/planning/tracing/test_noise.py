"""Paths with noise near a positioner's pole, where the turn of the table is free."""

import numpy as np
import pytest

import armcontour as ac

# Half the width of the block, its height, and the radius of its edges [m].
HALF = 0.06
HEIGHT = 0.08
EDGE = 0.008
# Where the axis of the table meets its surface [m].
TABLE = np.array([0.9, 0.0, 0.4])
TILT = np.radians(10)
NOISES = (0.0, 5e-10, 1e-8, 1e-6)


def side(angle):
    """Points up a side of the block and over its edge, and tool axes into it, (n, 3) each."""
    out = np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    points = [HALF * out + z * up for z in np.linspace(0.03, HEIGHT - EDGE, 6)]
    axes = [-out] * 6
    for turned in np.linspace(0, np.pi / 2, 9)[1:]:
        normal = np.cos(turned) * out + np.sin(turned) * up
        points.append((HALF - EDGE) * out + (HEIGHT - EDGE) * up + EDGE * normal)
        axes.append(-normal)
    return np.array(points), np.array(axes)


def over_block(angle):
    """Points and tool axes up a side, along a curve over the top, and down another side."""
    up, into = side(0.0)
    down, out = side(angle)
    share = np.linspace(0, 1, 26)[1:-1, None]
    middle = np.array([0.0, 0.0, HEIGHT])
    top = (1 - share) ** 2 * up[-1] + 2 * share * (1 - share) * middle + share**2 * down[-1]
    axes = np.tile([0.0, 0.0, -1.0], (len(top), 1))
    return np.vstack([up, top, down[::-1]]), np.vstack([into, axes, out[::-1]])


def rounded(points, axes, noise):
    """The path in the frame of the arm's base, with rounded corners."""
    moved = points + TABLE + np.random.default_rng(1).uniform(-noise, noise, points.shape)
    path = ac.Path.polyline(moved).pointing(axes)
    return ac.round_corners(path, tolerance=2e-4, angular_tolerance=np.radians(2))


def axis(name, along, origin, lower, upper):
    return ac.PositionerAxis(
        name=name, axis=along, origin=origin, lower=lower, upper=upper, velocity=1.5,
        acceleration=2.0,
    )  # fmt: skip


def cell(tilt):
    """A UR10e with a straight torch, and a table that tilts by joint 2 and turns by joint 1."""
    axes = (
        axis("tilt", (0.0, 1.0, 0.0), (0.9, 0.0, 0.3), -1.75, 1.75),
        axis("turn", (0.0, 0.0, 1.0), tuple(TABLE), -7.0, 7.0),
    )
    arm = ac.load_arm("ur10e", tool=ac.Frame(position=(0.0, 0.0, 0.3)))
    return arm.with_positioner(ac.Positioner(axes=axes, tilt=tilt))


# Denavit-Hartenberg parameters of a UR10e, as published by its maker: a, d [m] and alpha.
UR10E = (
    (0.0, 0.1807, np.pi / 2),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, np.pi / 2),
    (0.0, 0.11985, -np.pi / 2),
    (0.0, 0.11655, 0.0),
)


def about(axis, angle, origin):
    """Transform of a rotation about a line."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turned = np.eye(4)
    turned[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    turned[:3, 3] = origin - turned[:3, :3] @ origin
    return turned


def tool_on_floor(q):
    """Transform from the tool to the arm's base, by Denavit-Hartenberg parameters."""
    pose = np.eye(4)
    for angle, (a, d, alpha) in zip(q, UR10E, strict=True):
        cos = np.cos(angle)
        sin = np.sin(angle)
        tilted = np.sin(alpha)
        along = np.cos(alpha)
        pose = pose @ np.array([
            [cos, -sin * along, sin * tilted, a * cos],
            [sin, cos * along, -cos * tilted, a * sin],
            [0, tilted, along, d],
            [0, 0, 0, 1],
        ])  # fmt: skip
    return (
        pose
        @ about((0, 0, 1), 0.0, np.zeros(3))
        @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.3], [0, 0, 0, 1]])
    )


def part_on_floor(turn, tilt):
    """Motion of the part from its place with both axes at 0."""
    tilted = about((0, 1, 0), tilt, np.array([0.9, 0.0, 0.3]))
    return tilted @ about((0, 0, 1), turn, TABLE)


def distances(tool, points):
    """Distances of tool points, (n, 3), from the polyline through points [m]."""
    nearest = np.full(len(tool), np.inf)
    for begin, end in zip(points[:-1], points[1:], strict=True):
        step = end - begin
        share = np.clip((tool - begin) @ step / (step @ step), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(tool - begin - share[:, None] * step, axis=1))
    return nearest


@pytest.mark.parametrize("tilt", [TILT, None])
def test_noise_does_not_change_duration(tilt):
    arm = cell(tilt)
    points, axes = over_block(np.pi / 2)
    durations = []
    for noise in NOISES:
        path = rounded(points, axes, noise)
        plan = ac.plan(path, arm, arm.limits.replace(speed=0.006))
        durations.append(plan.duration)
        q = plan(np.linspace(0, plan.duration, 300))
        tool = np.array([np.linalg.inv(part_on_floor(*x[:2])) @ tool_on_floor(x[2:]) for x in q])
        # Rounding leaves the corners by at most 0.2 mm.
        assert distances(tool[:, :3, 3], points + TABLE).max() < 2.01e-4
        # The table turns on top of the block, by the angle between the sides, and not back.
        assert np.abs(np.diff(q[:, 0])).sum() < np.pi / 2 + 0.1
        if tilt is not None:
            floor = np.array([tool_on_floor(x[2:]) for x in q])
            assert np.arccos(-floor[:, 2, 2]).max() <= tilt + 1e-9
    assert np.ptp(durations) < 0.005 * min(durations)


def test_job_file_with_rounded_numbers_is_planned(tmp_path):
    points, axes = over_block(np.pi / 2)
    durations = []
    for digits in (12, 6):
        file = tmp_path / f"seam{digits}.csv"
        rows = ["x [mm],y [mm],z [mm],ax,ay,az"]
        for point, direction in zip(1e3 * points, axes, strict=True):
            numbers = [f"{x:.{digits}f}" for x in (*point, *direction)]
            rows.append(",".join(numbers))
        file.write_text("\n".join(rows))
        job = ac.read_job(file, cell="ur10e_positioner", patch={("scene", "obstacles"): []})
        durations.append(ac.run(job).runs["compensated"].trajectory.duration)
    assert np.ptp(durations) < 0.005 * min(durations)
