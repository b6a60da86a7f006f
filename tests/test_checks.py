"""Checks of given values, and arrays as compiled functions take them."""

import copy
import pickle
from dataclasses import FrozenInstanceError
from types import MappingProxyType

import numpy as np
import pytest

import armcontour as ac
from armcontour import InvalidInput, _checks
from armcontour._checks import check_name, for_kernel
from armcontour.scene import Box, Obstacle, Scene


def test_what_is_no_number_is_refused(refuses):
    # A value that is missing must not come back as whatever stands below the mask.
    masked = np.ma.masked_array([0.1, 0.2], mask=[False, True])
    for given in (masked, None, "5 mm", [0.1, np.nan]):
        refuses(lambda x=given: _checks.numbers("x", x, "m"), InvalidInput)
    refuses(lambda: _checks.number("speed", [0.1], "m/s"), InvalidInput, "not an array of 1.")
    given = np.ma.masked_array([0.1, 0.2], mask=False)
    assert _checks.numbers("x", given, "m").tolist() == [0.1, 0.2]


def test_arrays_for_kernels_are_copied_where_needed_only():
    own = np.arange(6.0).reshape(2, 3)
    assert for_kernel(own) is own
    locked = own.copy()
    locked.setflags(write=False)
    for other in (locked, own.T, own[:, ::2], own.astype(int), own.tolist(), own.astype(">f8")):
        found = for_kernel(other)
        assert found is not other and np.array_equal(found, np.asarray(other))
        assert found.dtype == np.float64 and found.dtype.isnative
        assert found.flags.c_contiguous and found.flags.writeable


def test_a_name_has_printable_characters_only():
    assert check_name("name", "Kreis 1 – Ω") == "Kreis 1 – Ω" and check_name("name", "") == ""
    with pytest.raises(InvalidInput, match=r"U\+0007"):
        check_name("name", "a\x07b")


def arrays_of(x, name, seen):
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


def pickled(x):
    return pickle.loads(pickle.dumps(x))


@pytest.mark.parametrize("copied", [copy.deepcopy, pickled])
def test_copies_are_locked_as_what_was_copied(copied, objective, arm, limits, servo, conventional):
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
        *(cell, rounded, planned, taught, plant, executed, space, turned, planned.sample(0.01)),
        *(ac.evaluate(executed, objective), ac.Program(moves=(ac.Contour(path=rounded),))),
        ac.smooth_curvature(rounded, tolerance=1e-4),
    )
    for x in everything:
        given, found = (dict(arrays_of(y, "", {})) for y in (x, copied(x)))
        assert given and found.keys() == given.keys(), type(x)
        for name, array in found.items():
            assert array.flags.writeable == given[name].flags.writeable, name
            assert np.array_equal(array, given[name], equal_nan=array.dtype.kind == "f"), name
    for x in (plant, space):
        with pytest.raises(FrozenInstanceError):
            copied(x).limits = limits


def test_copies_work_as_what_was_copied(conventional, arm, limits, refuses):
    planned = ac.plan(ac.Path.polyline([(0.35, 0.10), (0.41, 0.15)]), arm, limits)
    for x in (planned, conventional):
        other = pickled(x)
        assert np.array_equal(other([0.1, 0.2], 2), x([0.1, 0.2], 2))
        assert np.array_equal(other.path(0.01), x.path(0.01))
    assert np.array_equal(copy.deepcopy(arm).forward([0.3, 0.8]), arm.forward([0.3, 0.8]))
    for value, state in ((ac.Frame(), [1, 2]), (ac.load_arm("pmk3s"), {"name": "pmk3s"})):
        refuses(lambda x=value, y=state: x.__setstate__(y), InvalidInput, "another version")
