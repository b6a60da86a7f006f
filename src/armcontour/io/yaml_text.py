"""YAML without its traps: no key twice, and `1e-3` is a number."""

from __future__ import annotations

import re
from typing import Any

import yaml

from armcontour.errors import InvalidInput

# A million corner points is a large job.
MOST_VALUES = 10_000_000


class _Loader(yaml.SafeLoader):
    """Safe loading with the number format of YAML 1.2."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """A mapping whose keys are all different."""
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=deep)
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} stands twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def load(text: str, source: str) -> Any:
    """The document in `text`.

    Raises:
        InvalidInput: Not YAML, or a key that stands twice; says where.
    """
    try:
        data = yaml.load(text, Loader=_Loader)
        _refuse_flood(data, source)
        return data
    except RecursionError:
        raise InvalidInput(f"{source} is not valid YAML: it is nested too deeply.") from None
    except yaml.YAMLError as error:
        raise InvalidInput(f"{source} is not valid YAML: {_where(error)}.") from None
    except (ValueError, TypeError) as error:
        raise InvalidInput(f"{source} is not valid YAML: {error}.") from None


def _refuse_flood(data: Any, source: str) -> None:
    """Refuse a document whose aliases stand for more than anybody would write."""
    sizes: dict[int, int] = {}

    def size(value: Any) -> int:
        if not isinstance(value, dict | list):
            return 1
        if id(value) not in sizes:
            sizes[id(value)] = MOST_VALUES + 1  # what holds itself is endless
            inner = value.values() if isinstance(value, dict) else value
            sizes[id(value)] = 1 + sum(size(x) for x in inner)
        return sizes[id(value)]

    if size(data) > MOST_VALUES:
        raise InvalidInput(
            f"{source} stands for more than {MOST_VALUES} values: use fewer aliases."
        )


def _where(error: yaml.YAMLError) -> str:
    """What is wrong, and its line and column."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"{error.problem} (line {mark.line + 1}, column {mark.column + 1})"
    return " ".join(str(error).split())
