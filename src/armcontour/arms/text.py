"""Text files of arms: read, and YAML with the tags that the field uses for angles."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Any

from armcontour.errors import InvalidInput


def read_bytes(file: FilePath, what: str) -> bytes:
    """The content of a file.

    Raises:
        InvalidInput: There is no such file, or it cannot be read.
    """
    if not file.is_file():
        raise InvalidInput(f"There is no {what} {file}.")
    try:
        return file.read_bytes()
    except OSError as error:
        raise InvalidInput(f"The {what} {file} cannot be read: {error.strerror}.") from None


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
                return float(str(node.value)) * unit
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
    if not isinstance(value, bool):
        try:
            found = float(value)
        except (TypeError, ValueError):
            found = math.nan
        if math.isfinite(found):
            return found
    raise InvalidInput(
        f"{where} must be a number, not {value!r}; expressions are not worked out, but an angle "
        "may be written as !degrees 90."
    )
