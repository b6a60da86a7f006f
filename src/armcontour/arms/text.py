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
        InvalidInput: Not YAML; says where.
    """
    import yaml

    class Loader(yaml.SafeLoader):
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
    try:
        return yaml.load(content.decode("utf-8"), Loader=Loader)
    except UnicodeDecodeError as error:
        raise InvalidInput(f"{file} is not YAML: it is not text in UTF-8 ({error}).") from None
    except RecursionError:
        raise InvalidInput(f"{file} is not YAML: it is nested too deeply.") from None
    except yaml.YAMLError as error:
        raise InvalidInput(f"{file} is not YAML: {' '.join(str(error).split())}.") from None


def number(where: str, value: Any) -> float:
    """A number of a data file, `1e-3` too, which YAML takes for text.

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
