"""YAML without its traps: no key twice, and `1e-3` is a number."""

from __future__ import annotations

import re
from typing import Any

import yaml

from armcontour.errors import InvalidInput

# A million corner points is a large job.
MOST_VALUES = 10_000_000


class Loader(yaml.SafeLoader):
    """Safe loading with the number format of YAML 1.2."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """A mapping whose keys are all different, before what it merges is added to it."""
        node = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"the key {key.value!r} stands twice", key.start_mark
                    )
                seen.add((key.tag, key.value))
        return node


Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def load(content: str | bytes, source: str, loader: type[Loader] = Loader) -> Any:
    """The document in a text, or in the bytes of a file in UTF-8.

    Args:
        content: The text.
        source: What it is, for messages.
        loader: One that knows more tags.

    Raises:
        InvalidInput: Not YAML, or a key that stands twice; says where.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8")
        data = yaml.load(text, Loader=loader)
        _refuse_flood(data, source)
        return data
    except UnicodeDecodeError as error:
        raise InvalidInput(
            f"{source} is not valid YAML: it is not text in UTF-8 ({error})."
        ) from None
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
