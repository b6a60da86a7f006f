"""Frames of parts and tools, measured from joint positions at touched points."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.robot.measurement import measure_part, measure_tool

ARM = ac.load_arm("ur5e")
DOWN = Rotation.from_euler("x", np.pi).as_matrix()
START = ARM.inverse(ac.Frame((0.4, 0.0, 0.1), DOWN))
# A part of 200 x 100 mm, and its true frame.
CORNERS = np.array([(0, 0, 0), (0.2, 0, 0), (0.2, 0.1, 0), (0, 0.1, 0)])
TRUE = ac.Frame.rpy((0.4, -0.1, 0.1), (0.02, -0.01, 0.3))
# Noise of each coordinate of a touch [m].
NOISE = 1e-4


def placed(points, frame=TRUE):
    """Return points of the drawing in the work frame."""
    return points @ frame.rotation.T + frame.position


def joints_at(positions, arm=ARM):
    """Return joint positions at which the tool, pointing down, is at positions."""
    return np.array([arm.inverse(ac.Frame(x, DOWN), near=START) for x in positions])


def real_arm(random):
    """Return an arm whose frames differ from the nominal ones by 0.5 mm and 1 mrad."""
    chain = ARM.chain
    shifts = random.standard_normal(chain.positions.shape) * 5e-4 / np.sqrt(3)
    turns = Rotation.from_rotvec(random.standard_normal((ARM.dof, 3)) * 1e-3 / np.sqrt(3))
    rotations = chain.rotations @ turns.as_matrix()
    moved = chain.replace(positions=chain.positions + shifts, rotations=rotations)
    return ac.SerialArm(name="real", chain=moved, limits=ARM.limits)


def test_exact_touches_give_the_frame_of_the_part():
    measured = measure_part(ARM, CORNERS, joints_at(placed(CORNERS)))
    np.testing.assert_allclose(measured.frame.position, TRUE.position, atol=1e-9)
    np.testing.assert_allclose(measured.frame.rotation, TRUE.rotation, atol=1e-9)
    assert measured.residuals.max() < 1e-9
    assert measured.noise == 1e-4


def test_frame_is_the_best_of_all_frames():
    random = np.random.default_rng(3)
    touched = placed(CORNERS) + random.standard_normal(CORNERS.shape) * NOISE
    measured = measure_part(ARM, CORNERS, joints_at(touched))

    def squares(frame):
        return ((placed(CORNERS, frame) - touched) ** 2).sum()

    best = squares(measured.frame)
    for _ in range(200):
        change = ac.Frame.rpy(*random.standard_normal((2, 3)) * 1e-5)
        assert squares(change @ measured.frame) > best


def grid_on_part():
    """Return 20 points all over the part, in its drawing."""
    x, y = np.meshgrid(np.linspace(0, 0.2, 5), np.linspace(0, 0.1, 4))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def largest_error(real, frame):
    """Return the largest error of a real arm that is moved over the part by the nominal model."""
    executed = real.tool_position(joints_at(placed(grid_on_part(), frame)))
    return np.linalg.norm(executed - placed(grid_on_part()), axis=1).max()


def test_real_arms_reach_a_measured_part_as_exactly_as_expected():
    """Twelve real arms touch four corners with noise; pendant coordinates are five times worse."""
    errors = []
    ratios = []
    errors_of_coordinates = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        real = real_arm(random)
        touched = placed(CORNERS) + random.standard_normal(CORNERS.shape) * NOISE
        measured = measure_part(ARM, CORNERS, joints_at(touched, real), region=grid_on_part())
        errors.append(largest_error(real, measured.frame))
        ratios.append(errors[-1] / measured.expected_error)
        # The pendant knows the real arm, so its coordinates are the touched positions.
        coordinates = measure_part(ARM, CORNERS, joints_at(touched))
        errors_of_coordinates.append(largest_error(real, coordinates.frame))
    assert all(0.5 < ratio < 2 for ratio in ratios)
    assert np.median(errors) == pytest.approx(0.19e-3, rel=0.05)
    assert np.median(errors_of_coordinates) == pytest.approx(1.03e-3, rel=0.05)


def test_expected_error_is_the_mean_of_the_largest_error_on_the_part():
    """By simulated measurements whose frames are fitted by another library."""
    random = np.random.default_rng(5)
    q = joints_at(placed(CORNERS))
    far = np.array([(0.0, 0.0, 0.0), (0.6, 0.3, 0.0)])
    measured = measure_part(ARM, CORNERS, q, noise=NOISE, region=far)
    largest = []
    for _ in range(2000):
        touched = placed(CORNERS) + random.standard_normal(CORNERS.shape) * NOISE
        rotation, _ = Rotation.align_vectors(
            touched - touched.mean(axis=0), CORNERS - CORNERS.mean(axis=0)
        )
        position = touched.mean(axis=0) - rotation.apply(CORNERS.mean(axis=0))
        errors = rotation.apply(far) + position - placed(far)
        largest.append(np.linalg.norm(errors, axis=1).max())
    assert measured.expected_error == pytest.approx(np.mean(largest), rel=0.1)


def test_planar_arm_measures_in_its_plane():
    arm = ac.load_arm("pmk3s")
    drawn = np.array([(0.0, 0.0), (0.05, 0.0), (0.05, 0.05)])
    turned = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    q = arm.inverse(drawn @ turned.T + [0.3, 0.15])
    measured = measure_part(arm, drawn, q)
    assert measured.frame.is_planar_transform
    np.testing.assert_allclose(measured.frame.position, [0.3, 0.15, 0.0], atol=1e-9)
    np.testing.assert_allclose(measured.frame.rotation[:2, :2], turned, atol=1e-9)


def test_part_on_a_rail_is_measured_at_several_places_of_the_rail():
    rail = ac.Rail(axis=(1.0, 0.0, 0.0), upper=1.0, velocity=1.0, acceleration=1.0)
    arm = ARM.with_rail(rail)
    positions = np.array([0.0, 0.03, 0.06, 0.02])
    fixed = joints_at(placed(CORNERS) - np.outer(positions, [1.0, 0.0, 0.0]))
    measured = measure_part(arm, CORNERS, np.column_stack([positions, fixed]))
    np.testing.assert_allclose(measured.frame.position, TRUE.position, atol=1e-9)


def test_three_point_method_gives_the_frame_of_its_axes():
    axes = np.array([(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.03, 0.08, 0.0)])
    measured = measure_part(ARM, None, joints_at(placed(axes)))
    np.testing.assert_allclose(measured.frame.position, TRUE.position, atol=1e-9)
    np.testing.assert_allclose(measured.frame.rotation, TRUE.rotation, atol=1e-8)
    # The origin alone has the noise of one touch, so no part of the region is better.
    assert measured.expected_error > np.sqrt(3) * 0.9 * NOISE


POSES = Rotation.from_euler("xyz", [[3, 0, 0], [3, 0.6, 0], [3, 0, 2], [2.5, 0, 1], [3.4, 0.2, 0]])
TOOL = np.array([0.01, 0.02, 0.15])


def joints_touching(point, rotations=POSES, tool=TOOL):
    """Return joint positions at which the centre of a tool is at a point, in orientations."""
    arm = ARM.with_tool(tool)
    return np.array([arm.inverse(ac.Frame(point, x.as_matrix())) for x in rotations])


def test_poses_that_touch_one_point_give_the_tool():
    measured = measure_tool(ARM, joints_touching((0.4, 0.0, 0.2)))
    np.testing.assert_allclose(measured.frame.position, TOOL, atol=1e-9)
    np.testing.assert_allclose(measured.point, [0.4, 0.0, 0.2], atol=1e-9)


def test_tool_does_not_depend_on_tool_and_work_frame_of_the_arm():
    q = joints_touching((0.4, 0.0, 0.2))
    other = ARM.with_tool((0.0, 0.0, 0.5)).with_work((0.3, 0.2, 0.1))
    measured = measure_tool(other, q)
    np.testing.assert_allclose(measured.frame.position, TOOL, atol=1e-9)


def test_expected_error_of_a_tool_is_that_of_simulated_measurements():
    random = np.random.default_rng(1)
    q = joints_touching((0.4, 0.0, 0.2))
    expected = measure_tool(ARM, q, noise=NOISE).expected_error
    squares = []
    for _ in range(60):
        touched = [(0.4, 0.0, 0.2) + random.standard_normal(3) * NOISE for _ in POSES]
        noisy = np.array(
            [
                ARM.with_tool(TOOL).inverse(ac.Frame(point, x.as_matrix()), near=near)
                for point, x, near in zip(touched, POSES, q, strict=True)
            ]
        )
        tool = measure_tool(ARM, noisy).frame.position
        squares.append(((tool - TOOL) ** 2).sum())
    assert np.sqrt(np.mean(squares)) == pytest.approx(expected, rel=0.3)


def refusal(call):
    """Return the error of a call."""
    with pytest.raises(ac.InvalidInput) as caught:
        call()
    return caught.value


def added_point(message):
    """Return the point that a message proposes to touch as well [m]."""
    text = message.split("Also touch a point near (")[1].split(")")[0]
    return np.array([float(x) for x in text.split(",")]) / 1e3


@pytest.mark.parametrize(
    "points",
    [
        [(0, 0, 0), (0.1, 0, 0), (0.2, 0, 0)],
        [(0, 0, 0), (0.1, 0, 0), (0.2, 0.002, 0)],
        [(0, 0, 0), (0.002, 0, 0), (0, 0.002, 0)],
        [(0, 0, 0), (0, 0, 0), (0, 0, 0)],
    ],
    ids=["line", "nearly a line", "close together", "one place"],
)
def test_touches_that_do_not_determine_the_part_are_refused_with_a_remedy(points):
    points = np.array(points, dtype=float)
    error = refusal(lambda: measure_part(ARM, points, joints_at(placed(points)), region=CORNERS))
    while True:
        # One point is proposed at a time, and following the proposals ends with a frame.
        points = np.concatenate([points, added_point(str(error))[None]])
        assert len(points) < 7
        try:
            measured = measure_part(ARM, points, joints_at(placed(points)), region=CORNERS)
        except ac.InvalidInput as further:
            error = further
        else:
            break
    np.testing.assert_allclose(measured.frame.position, TRUE.position, atol=1e-7)


def test_mistaken_touch_is_named():
    drawn = np.concatenate([CORNERS, [(0.1, 0.05, 0.0)]])
    q = joints_at(placed(drawn))
    drawn[2, 0] += 0.01
    error = refusal(lambda: measure_part(ARM, drawn, q))
    assert error.index == 2
    assert "Touch 3 does not fit its point (210, 100, 0) mm" in str(error)


def test_swapped_rows_are_refused_with_the_right_order():
    error = refusal(lambda: measure_part(ARM, CORNERS[[1, 0, 2]], joints_at(placed(CORNERS[:3]))))
    assert error.limit == "order"
    assert "2, 1, 3" in str(error)


def test_touches_of_another_part_are_refused_with_both_distances():
    other = CORNERS[:3] * [1.0, 1.5, 1.0]
    error = refusal(lambda: measure_part(ARM, CORNERS[:3], joints_at(placed(other))))
    assert "Points 2 and 3 are 100 mm apart in the drawing, but 150 mm" in str(error)
    assert error.allowed == pytest.approx(4 * NOISE)


def test_tool_that_turns_about_one_axis_only_is_refused():
    turns = Rotation.from_euler("xyz", [[3, 0, 0], [3, 0, 1], [3, 0, 2]])
    error = refusal(lambda: measure_tool(ARM, joints_touching((0.4, 0.0, 0.2), turns)))
    assert "about the flange's z axis" in str(error)
    # The remedy of the message: a pose that is tilted by 40 deg about another axis.
    tilted = turns[0] * Rotation.from_euler("x", 40, degrees=True)
    more = Rotation.concatenate([turns, tilted])
    measured = measure_tool(ARM, joints_touching((0.4, 0.0, 0.2), more))
    np.testing.assert_allclose(measured.frame.position, TOOL, atol=1e-8)


def test_pose_at_another_point_is_named():
    q = joints_touching((0.4, 0.0, 0.2))
    q[3] = joints_touching((0.42, 0.0, 0.2))[3]
    error = refusal(lambda: measure_tool(ARM, q))
    assert error.index == 3


def test_too_few_touches_are_refused():
    q = joints_at(placed(CORNERS))
    assert "3 or more points" in str(refusal(lambda: measure_part(ARM, CORNERS[:2], q[:2])))
    assert "3 or more poses" in str(refusal(lambda: measure_tool(ARM, q[:2])))
    assert "one row per touch" in str(refusal(lambda: measure_part(ARM, CORNERS, q[:, :5])))
    planar = ac.load_arm("pmk3s")
    assert "planar arm" in str(refusal(lambda: measure_tool(planar, np.zeros((4, 2)))))


def test_results_state_the_frame_and_each_residual():
    measured = measure_part(ARM, CORNERS, joints_at(placed(CORNERS)))
    data = measured.to_data()
    assert data["expected_error"].value == measured.expected_error
    assert len(data["residuals"].value) == 4
    assert "400.000" in str(measured)
    assert dataclasses.is_dataclass(measured)
