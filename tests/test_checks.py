"""Checks, errors, frames and small numerical functions."""

import copy
import pickle
from collections.abc import Mapping
from dataclasses import FrozenInstanceError, dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation
from tests.geometry.tables import refused

import armcontour as ac
from armcontour import InvalidInput, controllers, files, robot
from armcontour.core import checks, errors
from armcontour.core.checks import BoolArray, FloatArray, IntArray, check_name
from armcontour.core.fields import Checked, checked
from armcontour.core.frames import (
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
from armcontour.core.quantities import (
    AtLeast,
    Axes,
    Choice,
    Distance,
    JointVelocities,
    Name,
    NeededName,
    Quantity,
    Reserve,
    Seed,
    SpeedLimit,
)
from armcontour.core.quintics import solve_banded
from armcontour.program import smooth_curvature
from armcontour.robot.scene import Box, Obstacle, Scene


def test_invalid_numbers_are_refused(refuses):
    # A masked value must not be replaced by the value below the mask.
    masked = np.ma.masked_array([0.1, 0.2], mask=[False, True])
    for wrong in (masked, None, "5 mm", [0.1, np.nan]):
        refuses(lambda x=wrong: checks.check_numbers("x", x, "m"), InvalidInput)
    refuses(lambda: checks.check_number("speed", [0.1], "m/s"), InvalidInput, "not an array of 1.")
    values = np.ma.masked_array([0.1, 0.2], mask=False)
    assert checks.check_numbers("x", values, "m").tolist() == [0.1, 0.2]


def test_names_with_control_characters_are_refused():
    assert check_name("name", "Kreis 1 – Ω") == "Kreis 1 – Ω" and check_name("name", "") == ""
    with pytest.raises(InvalidInput, match=r"U\+0007"):
        check_name("name", "a\x07b")


def arrays_of(x, name, visited):
    """All arrays of an object of the package and of its parts, with their names."""
    if id(x) in visited:
        return
    visited[id(x)] = x
    if isinstance(x, np.ndarray):
        yield name, x
    elif isinstance(x, tuple | list):
        for y in x:
            yield from arrays_of(y, name, visited)
    elif isinstance(x, dict | MappingProxyType):
        for key, y in x.items():
            yield from arrays_of(y, f"{name}.{key}", visited)
    elif type(x).__module__.startswith("armcontour"):
        slots = getattr(type(x), "__dataclass_fields__", {})
        for key in {**slots, **getattr(x, "__dict__", {})}:
            # Dynamics are computed anew by copies of arms.
            if hasattr(x, key) and key != "dynamics":
                yield from arrays_of(getattr(x, key), f"{type(x).__name__}.{key}", visited)


def pickled(x):
    return pickle.loads(pickle.dumps(x))


@pytest.mark.parametrize("copied", [copy.deepcopy, pickled])
def test_copies_equal_their_originals(copied, objective, arm, limits, servo):
    rounded = ac.round_corners(objective, tolerance=5e-3)
    planned = ac.plan(rounded, arm, limits)
    set_points = ac.compensate(planned, servo)
    plant = ac.ServoPlant(arm, servo.for_joints(2), limits)
    executed = ac.simulate(set_points, plant)
    space = ac.load_arm("ur5e", payload=ac.Payload(mass=1.0))
    turned = ac.Path.polyline([(0.4, 0.1, 0.2), (0.45, 0.1, 0.2)]).pointing((0, 0, -1))
    assert space.shapes is not None
    cell = Scene(obstacles=(Obstacle(shape=Box(size=(0.1, 0.2, 0.3)), name="box"),))
    everything = (
        *(cell, rounded, planned, set_points, plant, executed, space, turned, planned.sample(0.01)),
        *(ac.evaluate(executed, objective), ac.Program(moves=(ac.Contour(path=rounded),))),
        smooth_curvature(rounded, tolerance=1e-4),
    )
    for x in everything:
        original, copy_arrays = (dict(arrays_of(y, "", {})) for y in (x, copied(x)))
        assert original and copy_arrays.keys() == original.keys(), type(x)
        for name, array in copy_arrays.items():
            assert np.array_equal(array, original[name], equal_nan=array.dtype.kind == "f"), name
    for x in (plant, space):
        with pytest.raises(FrozenInstanceError):
            copied(x).limits = limits


KINDS = (ac.InvalidInput, ac.Unreachable, ac.NotRealizable, ac.CompensationError, ac.ExecutionError)


def test_errors_have_exit_codes_and_one_base_class():
    assert [kind.exit_code for kind in (ac.ArmContourError, *KINDS)] == [1, 2, 3, 4, 5, 6]
    assert [issubclass(kind, ValueError) for kind in KINDS] == [True] + [False] * 4
    assert all(issubclass(kind, ac.ArmContourError) for kind in KINDS)
    classes = [x for x in vars(errors).values() if isinstance(x, type)]
    public = {*ac.__all__, *controllers.__all__, *files.__all__, *robot.__all__}
    assert {x.__name__ for x in classes if issubclass(x, ac.ArmContourError)} <= public


def test_invalid_files_and_arms_have_their_own_class(tmp_path, arm):
    other = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20)])
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "value.yaml").write_text("arm: pmk3s\nspeed: fast\n")
    for name, kind in (
        ("missing.yaml", files.FileError),
        ("bytes.yaml", files.FileError),
        ("value.yaml", InvalidInput),
    ):
        with pytest.raises(InvalidInput) as caught:
            ac.read_job(tmp_path / name)
        assert type(caught.value) is kind and caught.value.exit_code == 2
    # Limits for six joints do not fit an arm with two.
    for call in (
        lambda: ac.trace(path, other),
        lambda: arm.limits.replace(joint_acceleration=np.ones(6)).for_joints(2),
    ):
        with pytest.raises(robot.ArmMismatch):
            call()


def test_errors_contain_their_message_and_data():
    data = {"index": 3, "s": 0.5, "t": 2.0, "joint": 1, "limit": "speed", "needed": 2.0}
    for kind in KINDS:
        error = kind("It is so.", point=[1, 2], allowed=1.0, **data)
        assert str(error) == "It is so."
        assert error.point == (1.0, 2.0) and error.allowed == 1.0
        assert {name: getattr(error, name) for name in data} == data
        assert {getattr(kind("No."), name) for name in (*data, "point", "allowed")} == {None}


def test_messages_escape_control_sequences_and_do_not_repeat_a_file():
    error = ac.InvalidInput("no key '\x1b]52;c;cHduZWQ=\x1b\\' in \u202egpj.exe\nline\x85\ud800")
    assert str(error).isprintable()
    assert "\\x1b]52;" in str(error) and "\\u202e" in str(error) and "\\n" in str(error)
    assert str(ac.InvalidInput(str(error))) == str(error)
    assert str(ac.InvalidInput("größer als µ, 名前")) == "größer als µ, 名前"
    message = str(ac.InvalidInput("unknown key " + "x" * 1_000_000 + ": the keys are a, b."))
    assert len(message) <= 2000
    assert message.startswith("unknown key xx") and message.endswith("xx: the keys are a, b.")


@given(st.integers(0, 30), st.integers(1, 4), st.integers(1, 3), st.integers(0, 10**6))
def test_banded_systems_have_the_solutions_of_scipy(m, width, sides, seed):
    drawn = np.random.default_rng(seed)
    bands = drawn.uniform(-1.0, 1.0, (m, width))
    # Diagonally dominant, with either sign of the neighbours.
    bands[:, 0] = 2.0 * width + drawn.uniform(0.0, 1.0, m)
    right = drawn.normal(size=(m, sides))
    lower = bands.T.copy()
    solution = right.copy()
    # Entries beyond the last column are never read.
    for i in range(m):
        bands[i, m - i :] = np.nan
    solve_banded(bands, solution)
    if m:
        np.testing.assert_allclose(solution, solveh_banded(lower, right, lower=True), atol=1e-13)


SMALL = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-4]
LARGE = [1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi - 1e-12, np.pi]
RANDOM = np.random.default_rng(0)
AXES = [*np.eye(3), *-np.eye(3), *RANDOM.normal(size=(20, 3))]
TURNED = Rotation.from_rotvec([0.3, -0.2, 0.5])


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def test_exp_and_log_are_inverse_at_every_angle():
    for angle in (*SMALL, *LARGE):
        vectors = angle * np.array([unit(a) for a in AXES])
        matrices = exp(vectors)
        expected = Rotation.from_rotvec(vectors).as_matrix()
        np.testing.assert_allclose(matrices, expected, atol=1e-15, err_msg=angle)
        found = log(matrices)
        if angle > np.pi - 1e-7:  # either sign of the axis is the same turn, to rounding
            found *= np.where(np.sum(found * vectors, axis=1, keepdims=True) < 0, -1, 1)
        np.testing.assert_allclose(found, vectors, atol=4e-15, err_msg=angle)
        assert (np.linalg.norm(found, axis=1) <= np.pi * (1 + 1e-15)).all(), angle
    # A small turn keeps its digits.
    vector = 1e-9 * unit([1.0, 2.0, 3.0])
    np.testing.assert_allclose(log(exp(vector)), vector, rtol=1e-12)


def test_exp_log_and_quaternions_agree_with_scipy():
    turns = Rotation.random(5000, np.random.default_rng(1))
    converted = quaternions(turns.as_matrix())
    np.testing.assert_allclose(converted, turns.as_quat(canonical=True), atol=1e-14)
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
    converted = perpendicular(v)
    np.testing.assert_allclose(np.sum(converted * v, axis=1), 0.0, atol=1e-15)
    assert np.linalg.norm(converted, axis=1).min() == pytest.approx(np.sqrt(2 / 3))


def test_the_shortest_rotation_turns_one_direction_into_the_other():
    random = np.random.default_rng(4)
    first = random.normal(size=(50, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cross(first, random.normal(size=(50, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    for turn in (0.0, 1e-14, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-9, np.pi):
        second = np.cos(turn) * first + np.sin(turn) * across
        rotation = shortest(first, second)
        np.testing.assert_allclose(np.linalg.norm(rotation, axis=1), turn, atol=1e-14, err_msg=turn)
        turned = np.einsum("nij,nj->ni", exp(rotation), first)
        np.testing.assert_allclose(turned, second, atol=1e-12, err_msg=turn)
        # Nothing about the direction.
        assert (np.abs(np.sum(rotation * first, axis=1)) < 1e-12).all(), turn


def test_rotations_are_read_from_every_form():
    matrix = TURNED.as_matrix()
    quaternion = TURNED.as_quat()
    for form in (
        *(TURNED, matrix, matrix.tolist(), quaternion, -quaternion),
        *(quaternion * (1 + 5e-7), matrix + 1e-8),
    ):
        matrices = rotations("it", form)
        assert matrices.shape == (3, 3)
        np.testing.assert_allclose(matrices, matrix, atol=1e-7)
        np.testing.assert_allclose(matrices.T @ matrices, np.eye(3), atol=1e-15)
    # Of three or four, the arrays look like one of another form.
    for count in (1, 3, 4, 7):
        turns = Rotation.random(count, np.random.default_rng(5))
        for form in (turns, turns.as_matrix(), turns.as_quat()):
            np.testing.assert_allclose(rotations("it", form), turns.as_matrix(), atol=1e-15)
    last = Rotation.concatenate([turns[:3], Rotation.identity()])
    np.testing.assert_allclose(rotations("x", last.as_quat()), last.as_matrix(), atol=1e-15)
    # A quaternion of four digits is scaled.
    matrices = rotations("tool", [0.2588, 0.0, 0.0, 0.9659])
    np.testing.assert_allclose(matrices, from_rpy([np.pi / 6, 0.0, 0.0]), atol=1e-4)


def test_arrays_that_are_no_rotations_are_refused(refuses):
    for wrong, words in (
        (np.diag([1.0, 1.0, -1.0]), ("it has a matrix that is not a rotation", "right-handed")),
        (np.eye(3) * 1.1, ("not a rotation",)),
        (np.eye(3) * 1e200, ("must be between", "1e+200")),
        (np.eye(3) * 1e11, ("not a rotation",)),
        (np.full((3, 3), 1e11) * [[1, 1, 1], [1, -1, 1], [1, 1, -1]], ("not a rotation",)),
        (np.zeros((3, 3)), ("not a rotation",)),
        ([np.eye(3), np.eye(3)[::-1]], ("not a rotation",)),
        ([0.0, 0.0, 0.0, 1.1], ("quaternion (x, y, z, w) must have the length 1",)),
        ([0.0, 0.0, 0.0, 0.0], ("length 1",)),
        ([1.0, 2.0, 3.0], ("it must be rotation matrices (3 by 3) or quaternions", "(3,)")),
        (np.zeros((2, 2)), ("(2, 2)",)),
        (1.0, ("()",)),
        (np.full((3, 3), np.nan), ("finite",)),
        ("up", ("must be numbers",)),
        ([[1, 2], [3]], ("must be numbers",)),
    ):
        refuses(lambda x=wrong: rotations("it", x), ac.InvalidInput, *words)
    for arguments, words in (
        ({"position": [0, 0]}, ("position of a frame", "3 coordinates", "not 2")),
        ({"position": [0, 0, np.inf]}, ("position of a frame", "finite")),
        ({"rotation": [np.eye(3), np.eye(3)]}, ("one rotation",)),
        ({"rotation": np.eye(3) * 2}, ("rotation of a frame", "not a rotation")),
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


def test_chained_frames_equal_products_of_matrices_and_stay_rotations():
    random = np.random.default_rng(7)

    def homogeneous(frame):
        return np.block([[frame.rotation, frame.position[:, None]], [np.zeros(3), 1.0]])

    a, b, c = (
        Frame(position=random.normal(size=3), rotation=Rotation.random(None, random))
        for _ in range(3)
    )
    np.testing.assert_allclose(homogeneous(a @ b), homogeneous(a) @ homogeneous(b), atol=1e-14)
    np.testing.assert_allclose(homogeneous((a @ b) @ c), homogeneous(a @ (b @ c)), atol=1e-14)
    np.testing.assert_allclose(homogeneous(a.inverse), np.linalg.inv(homogeneous(a)), atol=1e-14)
    np.testing.assert_allclose(homogeneous(a @ a.inverse), np.eye(4), atol=1e-14)
    np.testing.assert_allclose(homogeneous(Frame() @ a), homogeneous(a), atol=1e-15)
    step = Frame(position=[1e-3, 0, 0], rotation=TURNED)
    product = Frame()
    for _ in range(1000):
        product = product @ step
    np.testing.assert_allclose(product.rotation.T @ product.rotation, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(product.rotation, (TURNED**1000).as_matrix(), atol=1e-11)
    position = np.zeros(3)
    frame = Frame(position=position)
    position[0] = 1.0
    assert frame.position[0] == 0.0
    for array in (frame.position, frame.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5.0


def test_a_transform_is_not_read_as_four_quaternions(refuses):
    transform = np.eye(4)
    transform[:3, :3] = TURNED.as_matrix()
    for place in ([0, 0, 0], [0.1, 0.2, 0.3]):
        transform[:3, 3] = place
        for call in (
            lambda: rotations("tool orientation", transform),
            lambda: Frame(rotation=transform),
            lambda: ac.Path.polyline(np.eye(3)).oriented(transform),
        ):
            refuses(call, ac.InvalidInput, "is a 4 by 4 transform", "Use Frame")


def test_a_warning_names_degrees_passed_as_radians():
    with pytest.warns(UserWarning, match=r"180 rad is more than a whole turn") as caught:
        Frame.rpy((0, 0, 0), (180, 0, 90))
    assert str(caught[0].message).endswith("use np.radians([180.0, 0.0, 90.0]).")
    assert len(caught) == 1 and caught[0].filename == __file__
    # A whole turn is no mistake.
    for angle in (2 * np.pi, -6.2832, 6.28):
        assert np.allclose(Frame.rpy((0, 0, 0), (0, 0, angle)).rotation, np.eye(3), atol=4e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gear(Checked):
    """A dataclass with one field of each kind that annotations declare."""

    name: NeededName = "gear"
    teeth: Annotated[int, AtLeast(3, 99)] = 12
    slip: Reserve = 0.0
    mode: Annotated[str, Choice(("soft", "hard"))] = "soft"
    side: Literal["left", "right"] = "left"
    width: Annotated[float, Quantity("m", "5 mm", within=(0.01, 0.2))] = 0.1
    speed: SpeedLimit | None = None
    rates: JointVelocities | None = None
    places: Annotated[FloatArray, Quantity("m"), Axes("n", 3)] | None = None
    times: Annotated[FloatArray, Quantity("s"), Axes("n")] | None = None
    parts: tuple[Name, ...] = ()
    lengths: Mapping[str, Distance] | None = None
    state: bool | Name = True


def test_values_are_checked_by_the_annotation_of_their_field():
    refused(
        (lambda: Gear(name=" "), "name of a gear", "empty"),
        (lambda: Gear(name="a\n"), "not printable"),
        (lambda: Gear(teeth=2), "teeth of a gear", "from 3 to 99", "2"),
        (lambda: Gear(teeth=3.5), "whole number"),
        (lambda: Gear(teeth=True), "not True"),
        (lambda: Gear(slip=1.0), "from 0 to below 1"),
        (lambda: Gear(slip=np.nan), "finite"),
        (lambda: Gear(mode="medium"), "soft, hard", "'medium'"),
        (lambda: Gear(side="top"), "left, right"),
        (lambda: Gear(width=0.0), "above zero"),
        (lambda: Gear(width=1.0), "from 0.01 to 0.2 m", "1 m"),
        (lambda: Gear(width=[0.1]), "one number in m", "(1,)"),
        (lambda: Gear(speed=-1.0), "above zero", {"limit": "speed"}),
        (lambda: Gear(rates=[1.0, -2.0]), "-2 rad/s at index 1", {"index": 1, "limit": "rates"}),
        (lambda: Gear(rates=[[-1.0, 1.0], [1.0, 2.0]]), "lower bound below zero"),
        (lambda: Gear(rates=[]), "one per joint"),
        (lambda: Gear(places=np.zeros((2, 2))), "shape (n, 3)", "(2, 2)"),
        (lambda: Gear(places=np.zeros((2, 3)), times=np.zeros(3)), "n = 2", "places"),
        (lambda: Gear(parts=("a", "b" * 81)), "81 characters"),
        (lambda: Gear(parts="ab"), "list of names"),
        (lambda: Gear(lengths={"a": 0.1, "b": -0.1}), "'b'", "not be negative"),
        (lambda: Gear(state=1.5), "state"),
    )


def test_checked_fields_are_converted_locked_and_shared():
    array = np.zeros((2, 3))
    gear = Gear(
        teeth=4.0, width=np.float64(0.1), places=array, parts=["a"], rates=np.inf, speed=np.inf
    )
    assert type(gear.teeth) is int and type(gear.width) is float and gear.parts == ("a",)
    assert gear.places is not array and not gear.places.flags.writeable and array.flags.writeable
    assert replace(gear, teeth=5).places is gear.places
    assert gear.rates == np.inf and gear.speed == np.inf and gear.times is None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Columns(Checked):
    """A dataclass with arrays that have no quantity."""

    values: FloatArray
    numbers: IntArray | None = None
    flags: BoolArray | None = None
    pairs: Annotated[FloatArray, Axes("n", 2)] | None = None


def test_arrays_without_a_quantity_are_checked_copied_and_locked(refuses):
    """With each version of NumPy, whose aliases of annotations differ."""
    values = np.zeros(2)
    numbers = np.zeros(2, dtype=np.intp)
    pairs = np.zeros((3, 2))
    for wrong in ("text", [0.0, "text"], None):
        refuses(lambda x=wrong: Columns(values=x), InvalidInput, "values of columns")
    refuses(lambda: Columns(values=values, numbers=[0.5]), InvalidInput, "numbers")
    refuses(lambda: Columns(values=values, flags=[0.0]), InvalidInput, "flags")
    refuses(lambda: Columns(values=values, pairs=values), InvalidInput, "pairs", "(n, 2)")
    refuses(lambda: ac.JointPath(breaks="abc", coefficients=5), InvalidInput, "breaks")
    columns = Columns(values=values, numbers=numbers, flags=numbers > 0, pairs=pairs)
    for name, original in (("values", values), ("numbers", numbers), ("pairs", pairs)):
        array = getattr(columns, name)
        assert array is not original and original.flags.writeable
        assert array.flags.owndata and not array.flags.writeable
    assert not columns.flags.flags.writeable


def test_arguments_are_read_by_their_annotations():
    @checked
    def turn(angle: Annotated[float, Quantity("rad", sign="positive")], *, often: Seed = 1):
        return angle, often

    assert turn(1, often=2.0) == (1.0, 2) and type(turn(1)[0]) is float
    refused(
        (lambda: turn(-1.0), "angle must be above zero", "-1 rad"),
        (lambda: turn(1.0, often=0.5), "often", "whole"),
        (lambda: turn(1.0, speed=2.0), "'speed'"),
    )
