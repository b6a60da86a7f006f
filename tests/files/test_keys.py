"""Keys of files and dataclasses, quantities in SI units, and data as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from importlib import resources
from types import MappingProxyType
from typing import Annotated

import numpy as np
import pytest
import yaml
from tests.files.tables import refusals

from armcontour.core import pool  # noqa: F401 - copies of read-only mappings
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import AtLeast, Choice, PartialFields, Ratio, Speed
from armcontour.core.render import jsonable
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import in_si, read_keys
from armcontour.files.job_file import cell_names, cell_text
from armcontour.files.job_model import CellModel
from armcontour.files.result_folder import to_json
from armcontour.robot.servo.model import Gains


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel.

    Args:
        speed: Speed of the rim [m/s], (3,); None is that of the
            cart.
        slip: Share that is lost.
    """

    speed: Speed | None = None
    slip: Ratio = 0.0

    def __post_init__(self):
        if self.slip >= 1:
            raise InvalidInput("A wheel must not slip wholly.")


@dataclass(frozen=True, kw_only=True)
class Driven(Wheel):
    """A wheel with a drive.

    Args:
        gains: Gains of the drive [1/s], (dof,).
        mode: How the drive works.
        teeth: Number of teeth.
        axis: Its axis.
        wheels: Other wheels that it drives.
    """

    gains: Gains
    mode: Annotated[str, Choice(("soft", "hard"))] = "soft"
    teeth: Annotated[int, AtLeast(3)] = 12
    axis: Gains = field(default_factory=lambda: np.zeros(3))
    wheels: tuple[Wheel, ...] = ()


def read(data):
    return read_keys(Driven, data)


def test_keys_of_a_mapping_become_fields_of_a_dataclass():
    vehicle = read({"gains": "25 1/s", "slip": "10 %", "wheels": [{"speed": "50 mm/s"}]})
    assert isinstance(vehicle, Driven)
    assert (vehicle.gains, vehicle.slip, vehicle.mode, vehicle.teeth) == (25.0, 0.1, "soft", 12)
    assert vehicle.wheels == (Wheel(speed=0.05),)
    assert read({"gains": [1, "2 1/s"]}).gains.tolist() == [1.0, 2.0]
    # Where the default is made anew, null is that default.
    np.testing.assert_array_equal(read({"gains": 1, "axis": None}).axis, np.zeros(3))
    # Specified keys are distinguished from defaults, in the order of the fields.
    specified = read_keys(PartialFields(Driven), {"slip": 0.5, "speed": None})
    assert list(specified.items()) == [("speed", None), ("slip", 0.5)]
    assert read_keys(PartialFields(Driven), {}) == {}
    assert read_keys(PartialFields(Driven, null=True), {"gains": None}) == {"gains": None}


BAD = """
{} => the key gains is missing
{gains: 0} => gains: must be above zero, but is 0 1/s
{gains: 1, mode: medium} => mode: must be one of soft, hard, not 'medium'
{gains: 1, teeth: 2} => teeth: must be a whole number of at least 3, but is 2
{gains: 1, wheels: {}} => wheels: must be a list, not {}
{gains: 1, sped: 1} => unknown key sped: did you mean speed?
{gains: 1, wheels: [{}, {slip: 2}]} => wheels (item 2): A wheel must not slip
[] => the file: must be a mapping of keys, not []
"""


def test_invalid_values_are_refused_with_their_key():
    refusals(lambda x: read(yaml.safe_load(x)), BAD)


PAPER = resources.files("armcontour.jobs") / "library" / "paper.yaml"
MORE = """
name: more
arm: {name: ur5e, payload: {mass: 2 kg, center: [1 mm, 0, 5 cm]}, tool: {position: [0, 0, 120 mm]}}
path: {file: a.dxf, chord_tolerance: 20 um, layers: {cut: {speed: 50 mm/s, tolerance: 0.1 mm}}}
limits: {joint_velocity: [90 deg/s, 90 deg/s, 1, 2, 3, 4], joint_jerk: inf}
process: {lead_in: {shape: arc, length: 5 mm}, dwell: 20 ms, begin: [1 mm, 2 mm]}
servo: {kp: [25 1/s, 25, 25, 25, 25, 25], order: first, dead_time: 4 ms}
plant: {dead_time: 5 ms}
certificate: {tolerance: 0.1 mm, box: {gains: 10 %, dead_time: 1 ms}}
runs: {one: {timing: {reserve: 5 %}, corners: sharp}}
"""
TEXTS = {
    "paper": PAPER.read_text(encoding="utf-8"),
    "more": MORE,
    **{x: cell_text(x) for x in cell_names()},
}


def texts_with_units(data):
    """All texts that begin with a number and have a unit."""
    if isinstance(data, dict | list):
        inner = data.values() if isinstance(data, dict) else data
        return [y for x in inner for y in texts_with_units(x)]
    word = data.split(" ")[0] if isinstance(data, str) and " " in data else ""
    return [data] if word.lstrip("-").replace(".", "", 1).isdigit() else []


def test_readers_return_the_same_dataclass():
    for name, text in TEXTS.items():
        data = load(text, name)
        values = in_si(data, CellModel)
        assert texts_with_units(data) and texts_with_units(values) == []
        models = [read_keys(CellModel, x) for x in (data, values)]
        assert jsonable(asdict(models[0])) == jsonable(asdict(models[1]))
        assert in_si(values, CellModel) == values
    # What is no such quantity stays.
    data = {"limits": {"speed": "5 mm", "unknown": "5 mm"}, "corners": "sharp", "none": [1]}
    assert in_si(data, CellModel) == data


def test_arrays_are_lists_and_numbers_that_are_not_finite_null():
    data = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "numbers": [np.float64(0.1), np.int64(3), np.bool_(True), None],
        "tuple": (1, "two", -np.inf),
        "view": MappingProxyType({1: "one"}).values(),
        "nested": MappingProxyType({2: {"x": np.float32(0.5)}}),
    }
    assert json.loads(to_json(data)) == {
        "array": [[1.0, None], [None, 2.0]],
        "numbers": [0.1, 3, True, None],
        "tuple": [1, "two", None],
        "view": ["one"],
        "nested": {"2": {"x": 0.5}},
    }
    assert to_json({"a": 1}) == '{\n  "a": 1\n}\n'
    # What is no data is an error.
    with pytest.raises(TypeError):
        jsonable({"x": object()})
