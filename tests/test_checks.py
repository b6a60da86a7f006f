"""Checks of given values, and arrays as compiled functions take them."""

import copy
import pickle
from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import armcontour as ac
from armcontour import InvalidInput, _checks
from armcontour._checks import check_name, for_kernel
from armcontour.scene import Box, Obstacle, Scene


@pytest.mark.parametrize(
    ("given", "words"),
    [
        # A value that is missing must not come back as whatever stands below the mask.
        (np.ma.masked_array([0.1, 0.2], mask=[False, True]), "some are masked"),
        (None, "x must be numbers in m, not None."),
        ("5 mm", "not text"),
        ([0.1, np.nan], "finite, but is nan at index 1"),
    ],
)
def test_what_is_no_number_is_refused(refuses: Callable[..., None], given: Any, words: str) -> None:
    refuses(lambda: _checks.numbers("x", given, "m"), InvalidInput, words)


def test_a_masked_array_without_masked_values_is_an_array() -> None:
    given = np.ma.masked_array([0.1, 0.2], mask=False)
    assert _checks.numbers("x", given, "m").tolist() == [0.1, 0.2]


def test_a_list_in_the_place_of_a_number_is_said_to_be_one(refuses: Callable[..., None]) -> None:
    refuses(
        lambda: _checks.number("speed", [0.1], "m/s"),
        InvalidInput,
        "speed must be one number in m/s, not an array of 1.",
    )


def test_arrays_for_kernels_are_copied_where_needed_only() -> None:
    own = np.arange(6.0).reshape(2, 3)
    assert for_kernel(own) is own
    locked = own.copy()
    locked.setflags(write=False)
    for other in (locked, own.T, own[:, ::2], own.astype(int), own.tolist(), own.astype(">f8")):
        found = for_kernel(other)
        assert found is not other and np.array_equal(found, np.asarray(other))
        assert found.dtype == np.float64 and found.dtype.isnative
        assert found.flags.c_contiguous and found.flags.writeable


def test_a_name_has_printable_characters_only() -> None:
    assert check_name("name", "Kreis 1 – Ω") == "Kreis 1 – Ω" and check_name("name", "") == ""
    with pytest.raises(InvalidInput, match=r"The name has the character U\+0007"):
        check_name("name", "a\x07b")


def arrays_of(x: Any, name: str, seen: dict[int, Any]) -> Iterator[tuple[str, np.ndarray]]:
    """All arrays of an object of the package and of its parts, with their names."""
    if id(x) in seen:
        return
    seen[id(x)] = x
    if isinstance(x, np.ndarray):
        yield name, x
    elif isinstance(x, tuple | list):
        for y in x:
            yield from arrays_of(y, name, seen)
    elif isinstance(x, dict | MappingProxyType):
        for key, y in x.items():
            yield from arrays_of(y, f"{name}.{key}", seen)
    elif type(x).__module__.startswith("armcontour"):
        slots = getattr(type(x), "__dataclass_fields__", {})
        for key in {**slots, **getattr(x, "__dict__", {})}:
            # Dynamics are computed anew by copies of arms.
            if hasattr(x, key) and key != "dynamics":
                yield from arrays_of(getattr(x, key), f"{type(x).__name__}.{key}", seen)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_are_locked_as_what_was_copied(
    copied: Callable[[Any], Any],
    objective: ac.Path,
    arm: ac.PlanarTwoLink,
    limits: ac.Limits,
    servo: ac.ServoModel,
    conventional: ac.Trajectory,
) -> None:
    rounded = ac.round_corners(objective, tolerance=5e-3)
    planned = ac.plan(rounded, arm, limits)
    taught = ac.compensate(conventional, servo, method="none")
    plant = ac.ServoPlant(arm, servo.for_joints(2), limits)
    executed = ac.execute(taught, plant)
    space = ac.load_arm("ur5e", payload=ac.Payload(mass=1.0))
    turned = ac.Path.polyline([(0.4, 0.1, 0.2), (0.45, 0.1, 0.2)]).pointing((0, 0, -1))
    assert space.shapes is not None
    cell = Scene(obstacles=(Obstacle(shape=Box(size=(0.1, 0.2, 0.3)), name="box"),))
    everything = (
        cell,
        *(rounded, planned, taught, plant, executed, space, turned, planned.sample(0.01)),
        *(ac.evaluate(executed, objective), ac.Program(moves=(ac.Contour(path=rounded),))),
        ac.smooth_curvature(rounded, tolerance=1e-4),
    )
    for x in everything:
        other = copied(x)
        given = dict(arrays_of(x, "", {}))
        found = dict(arrays_of(other, "", {}))
        assert given and found.keys() == given.keys(), type(x)
        for name, array in found.items():
            assert array.flags.writeable == given[name].flags.writeable, name
            assert np.array_equal(array, given[name], equal_nan=array.dtype.kind == "f"), name
    for x in (plant, space):
        with pytest.raises(FrozenInstanceError, match="cannot be set"):
            copied(x).limits = limits


def test_copies_work_as_what_was_copied(
    conventional: ac.Trajectory, arm: ac.PlanarTwoLink, limits: ac.Limits
) -> None:
    planned = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)]), arm, limits)
    for x in (planned, conventional):
        other = pickle.loads(pickle.dumps(x))
        assert np.array_equal(other([0.1, 0.2], 2), x([0.1, 0.2], 2))
        assert np.array_equal(other.path(0.01), x.path(0.01))
    assert np.array_equal(copy.deepcopy(arm).forward([0.3, 0.8]), arm.forward([0.3, 0.8]))


def test_what_another_version_pickled_is_refused(refuses: Callable[..., None]) -> None:
    for value, state in ((ac.Frame(), [1, 2]), (ac.load_arm("pmk3s"), {"name": "pmk3s"})):
        words = f"This pickled {type(value).__name__} was made by another version of armcontour"
        refuses(lambda x=value, y=state: x.__setstate__(y), InvalidInput, words)
