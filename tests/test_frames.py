"""Frames and rotations: scipy's rotations as the oracle, the algebra of frames, and refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac
from armcontour.frames import (
    Frame,
    cross_matrix,
    exp,
    from_rpy,
    log,
    perpendicular,
    quaternions,
    rotations,
    shortest,
)

SMALL = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4]
LARGE = [1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12, np.pi]
RANDOM = np.random.default_rng(0)
AXES = [*np.eye(3), *-np.eye(3), *RANDOM.normal(size=(20, 3))]
TURNED = Rotation.from_rotvec([0.3, -0.2, 0.5])


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def test_exp_and_log_at_every_angle():
    for angle in (*SMALL, *LARGE):
        vectors = angle * np.array([unit(a) for a in AXES])
        matrices = exp(vectors)
        wanted = Rotation.from_rotvec(vectors).as_matrix()
        np.testing.assert_allclose(matrices, wanted, atol=1e-15, err_msg=angle)
        found = log(matrices)
        if angle > np.pi - 1e-7:  # either sign of the axis is the same turn, to rounding
            found *= np.where(np.sum(found * vectors, axis=1, keepdims=True) < 0, -1, 1)
        np.testing.assert_allclose(found, vectors, atol=4e-15, err_msg=angle)
        assert (np.linalg.norm(found, axis=1) <= np.pi * (1 + 1e-15)).all(), angle
    # A small turn keeps its digits.
    vector = 1e-9 * unit([1.0, 2.0, 3.0])
    np.testing.assert_allclose(log(exp(vector)), vector, rtol=1e-12)


def test_exp_log_and_quaternions_agree_with_scipy():
    turns = Rotation.random(5000, rng=np.random.default_rng(1))
    found = quaternions(turns.as_matrix())
    np.testing.assert_allclose(found, turns.as_quat(canonical=True), atol=1e-14)
    np.testing.assert_allclose(log(turns.as_matrix()), turns.as_rotvec(), atol=1e-14)
    vectors = np.array([[0.0, 0.0, 7.0], [10.0, -5.0, 3.0]])
    np.testing.assert_allclose(exp(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
    vectors = np.random.default_rng(2).uniform(-1, 1, size=(2, 3, 4, 3))
    assert exp(vectors).shape == (2, 3, 4, 3, 3)
    np.testing.assert_allclose(log(exp(vectors)), vectors, atol=1e-14)
    assert log(np.eye(3)).shape == (3,)
    v, w = np.random.default_rng(3).normal(size=(2, 10, 3))
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", cross_matrix(v), w), np.cross(v, w), atol=1e-15
    )
    v = np.array([unit(x) for x in [*AXES, (1, 1, 1)]])
    found = perpendicular(v)
    np.testing.assert_allclose(np.sum(found * v, axis=1), 0.0, atol=1e-15)
    assert np.linalg.norm(found, axis=1).min() == pytest.approx(np.sqrt(2 / 3))


def test_the_shortest_rotation_turns_one_direction_into_the_other():
    random = np.random.default_rng(4)
    first = random.normal(size=(50, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cross(first, random.normal(size=(50, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for turn in (0.0, 1e-14, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-9, np.pi):
        second = np.cos(turn) * first + np.sin(turn) * across
        found = shortest(first, second)
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), turn, atol=1e-14, err_msg=turn)
        turned = np.einsum("nij,nj->ni", exp(found), first)
        np.testing.assert_allclose(turned, second, atol=1e-12, err_msg=turn)
        # Nothing about the direction.
        assert (np.abs(np.sum(found * first, axis=1)) < 1e-12).all(), turn


def test_rotations_in_every_form():
    matrix, quaternion = TURNED.as_matrix(), TURNED.as_quat()
    for given in (
        *(TURNED, matrix, matrix.tolist(), quaternion, -quaternion),
        *(quaternion * (1 + 5e-7), matrix + 1e-8),
    ):
        found = rotations("it", given)
        assert found.shape == (3, 3)
        np.testing.assert_allclose(found, matrix, atol=1e-7)
        np.testing.assert_allclose(found.T @ found, np.eye(3), atol=1e-15)
    # Of three or four, the arrays look like one of another form.
    for count in (1, 3, 4, 7):
        turns = Rotation.random(count, rng=np.random.default_rng(5))
        for given in (turns, turns.as_matrix(), turns.as_quat()):
            np.testing.assert_allclose(rotations("it", given), turns.as_matrix(), atol=1e-15)
    last = Rotation.concatenate([turns[:3], Rotation.identity()])
    np.testing.assert_allclose(rotations("x", last.as_quat()), last.as_matrix(), atol=1e-15)
    # A quaternion of four digits is scaled.
    found = rotations("tool", [0.2588, 0.0, 0.0, 0.9659])
    np.testing.assert_allclose(found, from_rpy([np.pi / 6, 0.0, 0.0]), atol=1e-4)


def test_other_arrays_are_refused(refuses):
    for given, words in (
        (np.diag([1.0, 1.0, -1.0]), ("it has a matrix that is no rotation", "right-handed")),
        (np.eye(3) * 1.1, ("no rotation",)),
        (np.eye(3) * 1e200, ("must be between", "1e+200")),
        (np.eye(3) * 1e11, ("no rotation",)),
        (np.full((3, 3), 1e11) * [[1, 1, 1], [1, -1, 1], [1, 1, -1]], ("no rotation",)),
        (np.zeros((3, 3)), ("no rotation",)),
        ([np.eye(3), np.eye(3)[::-1]], ("no rotation",)),
        ([0.0, 0.0, 0.0, 1.1], ("quaternion (x, y, z, w) must have the length 1",)),
        ([0.0, 0.0, 0.0, 0.0], ("length 1",)),
        ([1.0, 2.0, 3.0], ("it must be rotation matrices (3 by 3) or quaternions", "(3,)")),
        (np.zeros((2, 2)), ("(2, 2)",)),
        (1.0, ("()",)),
        (np.full((3, 3), np.nan), ("finite",)),
        ("up", ("must be numbers",)),
        ([[1, 2], [3]], ("must be numbers",)),
    ):
        refuses(lambda given=given: rotations("it", given), ac.InvalidInput, *words)
    for arguments, words in (
        ({"position": [0, 0]}, ("position of a frame", "3 coordinates", "not 2")),
        ({"position": [0, 0, np.inf]}, ("position of a frame", "finite")),
        ({"rotation": [np.eye(3), np.eye(3)]}, ("one rotation",)),
        ({"rotation": np.eye(3) * 2}, ("rotation of a frame", "no rotation")),
    ):
        refuses(lambda arguments=arguments: Frame(**arguments), ac.InvalidInput, *words)
    for angles in ([1.0, 2.0], 1.0, [[1.0, 2.0]]):
        refuses(lambda angles=angles: from_rpy(angles), ac.InvalidInput, "three angles")


def test_roll_pitch_and_yaw_are_about_fixed_axes():
    angles = np.random.default_rng(6).uniform(-np.pi, np.pi, (50, 3))
    np.testing.assert_allclose(
        from_rpy(angles), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-15
    )
    frame = Frame.rpy([1, 2, 3], angles[0])
    np.testing.assert_allclose(frame.rotation, from_rpy(angles[0]), atol=1e-15)
    np.testing.assert_array_equal(frame.position, [1, 2, 3])


def test_frames_are_chained_like_matrices_and_stay_rotations():
    random = np.random.default_rng(7)

    def homogeneous(frame):
        return np.block([[frame.rotation, frame.position[:, None]], [np.zeros(3), 1.0]])

    a, b, c = (
        Frame(position=random.normal(size=3), rotation=Rotation.random(rng=random))
        for _ in range(3)
    )
    np.testing.assert_allclose(homogeneous(a @ b), homogeneous(a) @ homogeneous(b), atol=1e-14)
    np.testing.assert_allclose(homogeneous((a @ b) @ c), homogeneous(a @ (b @ c)), atol=1e-14)
    np.testing.assert_allclose(homogeneous(a.inverse), np.linalg.inv(homogeneous(a)), atol=1e-14)
    np.testing.assert_allclose(homogeneous(a @ a.inverse), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(homogeneous(Frame() @ a), homogeneous(a), atol=1e-15)
    step = Frame(position=[1e-3, 0, 0], rotation=TURNED)
    found = Frame()
    for _ in range(1000):
        found = found @ step
    np.testing.assert_allclose(found.rotation.T @ found.rotation, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(found.rotation, (TURNED**1000).as_matrix(), atol=1e-11)
    position = np.zeros(3)
    frame = Frame(position=position)
    position[0] = 1.0
    assert frame.position[0] == 0.0
    for array in (frame.position, frame.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5.0


def test_a_transform_is_no_four_quaternions(refuses):
    transform = np.eye(4)
    transform[:3, :3] = TURNED.as_matrix()
    for place in ([0, 0, 0], [0.1, 0.2, 0.3]):
        transform[:3, 3] = place
        for call in (
            lambda: rotations("tool orientation", transform),
            lambda: Frame(rotation=transform),
            lambda: ac.Path.polyline(np.eye(3)).oriented(transform),
        ):
            refuses(call, ac.InvalidInput, "is a 4 by 4 transform", "give Frame")


def test_degrees_given_for_radians_are_warned_of_with_what_was_meant():
    with pytest.warns(UserWarning, match=r"180 rad is more than a whole turn: for degrees") as told:
        Frame.rpy((0, 0, 0), (180, 0, 90))
    assert str(told[0].message).endswith("give np.radians([180.0, 0.0, 90.0]).")
    assert len(told) == 1 and told[0].filename == __file__
    # A whole turn is no mistake.
    for angle in (2 * np.pi, -6.2832, 6.28):
        assert np.allclose(Frame.rpy((0, 0, 0), (0, 0, angle)).rotation, np.eye(3), atol=4e-3)
