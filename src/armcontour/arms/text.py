"""Data files of arms: YAML with the tags that the field uses for angles, numbers and names."""

from __future__ import annotations

import math
from typing import Any

from armcontour._numbers import parse_number
from armcontour.errors import InvalidInput


def refuse_unprintable(where: str, name: str) -> None:
    """Refuse a name with characters that are not shown: reports and terminals would obey them.

    Raises:
        InvalidInput: Such a character; shows it escaped.
    """
    if not name.isprintable():
        raise InvalidInput(
            f"{where} has the name {ascii(name[:80])}, which holds a character that cannot be "
            "printed: take it out."
        )


def load_yaml(file: str, content: bytes) -> Any:
    """The document in `content`, with `!degrees` and `!radians` as numbers in radians.

    Raises:
        InvalidInput: Not YAML, or a key that stands twice; says where.
    """
    import yaml

    from armcontour import _yaml

    class Loader(_yaml.Loader):
        pass

    def angle(unit: float) -> Any:
        def construct(loader: yaml.SafeLoader, node: yaml.Node) -> float:
            try:
                return parse_number(str(node.value)) * unit
            except ValueError:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{node.value!r} is not an angle", node.start_mark
                ) from None

        return construct

    Loader.add_constructor("!degrees", angle(math.radians(1.0)))
    Loader.add_constructor("!radians", angle(1.0))
    return _yaml.load(content, file, Loader)


def number(where: str, value: Any) -> float:
    """A number of a data file.

    Raises:
        InvalidInput: Something else, such as an expression.
    """
    found = _finite(value)
    if found is None:
        raise InvalidInput(
            f"{where} must be a number, not {_shown(value)}; expressions are not worked out, but "
            "an angle may be written as !degrees 90."
        )
    return found


def numbers(where: str, value: Any, unit: str) -> Any:
    """A number of a data file, or a list of numbers, or of lists of them.

    Raises:
        InvalidInput: Something else among them.
    """
    if isinstance(value, list):
        return [numbers(where, x, unit) for x in value]
    found = _finite(value)
    if found is None:
        raise InvalidInput(f"{where} must be finite numbers in {unit}, not {_shown(value)}.")
    return found


def _finite(value: Any) -> float | None:
    """A value of a data file as a number, None if it is something else."""
    if isinstance(value, bool):
        return None
    try:
        found = parse_number(value) if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if math.isfinite(found) else None


def _shown(value: Any) -> str:
    try:
        return repr(value)[:80]
    except ValueError:
        # Python does not write down whole numbers of thousands of digits.
        return "a number of thousands of digits"
