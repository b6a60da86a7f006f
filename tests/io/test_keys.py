"""Keys of files, made from dataclasses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import create_model

from armcontour._quantities import AtLeast, Choice, Gains, Ratio, Speed
from armcontour.errors import InvalidInput
from armcontour.io import keys
from armcontour.io.keys import Given, Keys, descriptions, read_keys, schema_of


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

    def __post_init__(self) -> None:
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


def read(data: Any) -> Any:
    return read_keys(Keys(Driven), data, "cart.yaml")


def test_a_mapping_of_keys_becomes_the_dataclass() -> None:
    found = read({"gains": "25 1/s", "slip": "10 %", "wheels": [{"speed": "50 mm/s"}]})
    assert isinstance(found, Driven)
    assert (found.gains, found.slip, found.mode, found.teeth) == (25.0, 0.1, "soft", 12)
    assert found.wheels == (Wheel(speed=0.05),)
    assert read({"gains": [1, "2 1/s"]}).gains == [1.0, 2.0]
    # Where the default is made anew, null is that default.
    np.testing.assert_array_equal(read({"gains": 1, "axis": None}).axis, np.zeros(3))


def test_what_is_given_is_told_from_defaults() -> None:
    given = read_keys(Given(Driven), {"slip": 0.5, "speed": None}, "cart.yaml")
    assert given == {"speed": None, "slip": 0.5}
    assert list(given) == ["speed", "slip"], "the order is that of the fields"
    assert read_keys(Given(Driven), {}, "cart.yaml") == {}
    assert read_keys(Given(Driven, null=True), {"gains": None}, "cart.yaml") == {"gains": None}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, "the key gains is missing"),
        ({"gains": None}, "gains: must be a number in 1/s or text with a unit, not None"),
        ({"gains": 0}, "gains: must be above zero, but is 0 1/s"),
        ({"gains": 1, "mode": "medium"}, "mode: must be soft or hard, not 'medium'"),
        ({"gains": 1, "teeth": 2}, "teeth: must be at least 3, but is 2"),
        ({"gains": 1, "teeth": True}, "teeth: must be a whole number, not True"),
        ({"gains": 1, "wheels": {}}, "wheels: must be a list, not {}"),
        ({"gains": 1, "sped": 1}, r"unknown key sped: did you mean speed\?$"),
        (
            {"gains": 1, "wheels": [{"speedd": 1}]},
            r"key wheels \(item 1\).speedd: did you mean speed",
        ),
        ({"gains": 1, "wheels": [{}, {"slip": 2}]}, r"wheels \(item 2\): A wheel must not slip"),
        ([], r"the file: must be a mapping of keys, not \[\]"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(data: Any, words: str) -> None:
    with pytest.raises(InvalidInput, match=f"^cart.yaml: .*{words}"):
        read(data)


def test_docstrings_describe_keys_in_the_words_of_files() -> None:
    found = descriptions(Driven)
    assert found["speed"] == "Speed of the rim [m/s]; null is that of the cart."
    assert found["gains"] == "Gains of the drive [1/s]."
    schema = schema_of(Keys(Driven))
    assert schema["description"] == "A wheel with a drive."
    keys = schema["properties"]
    assert set(keys) == set(found) and schema["required"] == ["gains"]
    assert keys["teeth"] == {
        "default": 12, "description": "Number of teeth.", "minimum": 3, "title": "Teeth",
        "type": "integer",
    }  # fmt: skip
    assert keys["speed"]["anyOf"][0]["anyOf"][0] == {"type": "number", "exclusiveMinimum": 0}


@dataclass(frozen=True, kw_only=True)
class Light:
    """A light.

    Args:
        watts: Its power.
    """

    watts: Annotated[int, AtLeast(3)]


@dataclass(frozen=True, kw_only=True)
class Cart:
    """A cart.

    Args:
        front: Its front wheel.
        lamp: Its light.
    """

    front: Wheel | None = None
    lamp: Light | None = None


def test_what_checks_mappings_inside_is_built_when_a_file_has_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    built: list[str] = []

    def create(name: str, *args: Any, **fields: Any) -> Any:
        built.append(name)
        return create_model(name, *args, **fields)

    monkeypatch.setattr(keys, "create_model", create)
    mark = Keys(Cart)
    found = read_keys(mark, {"front": {"slip": "10 %"}}, "cart.yaml")
    assert found.front.slip == 0.1 and "Cart" in built and "Light" not in built
    # Its sentences, and its schema, are those of the whole file.
    with pytest.raises(InvalidInput, match=r"lamp\.watts: must be at least 3"):
        read_keys(mark, {"lamp": {"watts": 2}}, "cart.yaml")
    assert "watts" in schema_of(mark)["$defs"]["Light"]["properties"]
    assert read_keys(mark, {"lamp": {"watts": 5}}, "cart.yaml").lamp == Light(watts=5)
