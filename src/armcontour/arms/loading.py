"""Arms from data files: the built-in library, or the user's own file in the same form."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour.arms.arm import Arm
from armcontour.arms.limits import Limits
from armcontour.arms.planar import PlanarTwoLink
from armcontour.errors import InvalidInput

UNITS = {
    "base": "m",
    "links": "m",
    "joint_acceleration": "rad/s^2",
    "joint_velocity": "rad/s",
}


def arm_names() -> tuple[str, ...]:
    """Names of the built-in arms."""
    folder = resources.files("armcontour.arms") / "library"
    return tuple(sorted(x.name[:-5] for x in folder.iterdir() if x.name.endswith(".yaml")))


def load_arm(name: str | FilePath) -> Arm:
    """An arm by its built-in name, such as "pmk3s", or from a YAML file of the same form.

    Raises:
        InvalidInput: No such arm or file, or a file that does not describe an arm.
    """
    text = str(name)
    if text.endswith((".yaml", ".yml")):
        file = FilePath(text)
        if not file.is_file():
            raise InvalidInput(f"There is no arm file {text}.")
        try:
            return _arm(text, file.read_text(encoding="utf-8"))
        except UnicodeDecodeError as error:
            raise InvalidInput(f"{text} is not YAML: it is not text in UTF-8 ({error}).") from None
    if text not in arm_names():
        raise InvalidInput(
            f"There is no built-in arm {text!r}: the built-in arms are {', '.join(arm_names())}; "
            "your own arm goes in a .yaml file."
        )
    file_text = (resources.files("armcontour.arms") / "library" / f"{text}.yaml").read_text("utf-8")
    return _arm(f"{text}.yaml", file_text)


def _arm(file: str, text: str) -> Arm:
    import yaml

    try:
        data = yaml.safe_load(text)
    except RecursionError:
        raise InvalidInput(f"{file} is not YAML: it is nested too deeply.") from None
    except yaml.YAMLError as error:
        raise InvalidInput(f"{file} is not YAML: {' '.join(str(error).split())}.") from None
    known = {"name", "kind", "source", "base", "links", "limits"}
    if (
        not isinstance(data, Mapping)
        or not set(data) <= known
        or data.get("kind") != "planar_two_link"
    ):
        raise InvalidInput(
            f"{file} does not describe an arm: it takes the keys {', '.join(sorted(known))}, "
            "and its kind must be planar_two_link."
        )
    limits = data.get("limits") or {}
    if not isinstance(limits, Mapping):
        raise InvalidInput(f"{file}: limits must be named quantities, each with value and unit.")
    unknown = set(limits) - {"joint_acceleration", "joint_velocity"}
    if unknown:
        raise InvalidInput(
            f"{file}: unknown limit {sorted(unknown)[0]}: an arm has joint_acceleration and "
            "joint_velocity."
        )
    links = _value(file, "links", data)
    if not isinstance(links, list) or len(links) != 2:
        raise InvalidInput(f"{file}: links must be two lengths.")
    return PlanarTwoLink(
        name=str(data.get("name", file)),
        source=str(data.get("source", "")),
        base=_value(file, "base", data),
        links=(links[0], links[1]),
        limits=Limits(**{key: _value(file, key, limits) for key in limits}),
    )


def _value(file: str, key: str, data: Mapping[str, Any]) -> Any:
    quantity = data.get(key)
    if not isinstance(quantity, Mapping) or "value" not in quantity:
        raise InvalidInput(f"{file}: {key} must be a quantity with value, unit and source.")
    if quantity.get("unit") != UNITS[key]:
        raise InvalidInput(
            f"{file}: {key} must be given in {UNITS[key]}, not {quantity.get('unit')!r}."
        )
    return quantity["value"]
