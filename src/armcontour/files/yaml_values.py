"""Values as YAML text: on one line, or as blocks of several lines."""

from __future__ import annotations

from typing import Any

import yaml

from armcontour.core.yaml_layout import Loader

# A value that would be longer on one line becomes a block of several lines.
WIDTH = 100
INDENT = 2
TEXT = "tag:yaml.org,2002:str"


class Dumper(yaml.SafeDumper):
    """Writes what `Loader` reads, which has other numbers than PyYAML."""

    def ignore_aliases(self, data: Any) -> bool:
        """Equal values are written twice."""
        return True


def _represent_text(dumper: Dumper, text: str) -> yaml.ScalarNode:
    """A text, of which one with line breaks is written on one line."""
    lines = any(x in text for x in "\r\n\x85\u2028\u2029")
    return dumper.represent_scalar(TEXT, text, style='"' if lines else None)


Dumper.add_representer(str, _represent_text)
# What either of them takes for a number is quoted if it is text.
Dumper.yaml_implicit_resolvers = {
    first: [
        *Loader.yaml_implicit_resolvers.get(first, []),
        *yaml.SafeDumper.yaml_implicit_resolvers.get(first, []),
    ]
    for first in {*Loader.yaml_implicit_resolvers, *yaml.SafeDumper.yaml_implicit_resolvers}
}


def flow_text(value: Any, style: str | None = None) -> str:
    """A value on one line, as it can stand anywhere.

    Args:
        value: The value.
        style: The quotes of a text, if it is to have some.
    """
    quoted = style if isinstance(value, str) else None
    text = yaml.dump(
        [value],
        Dumper=Dumper,
        default_style=quoted,
        default_flow_style=True,
        sort_keys=False,
        width=float("inf"),
        allow_unicode=True,
    )
    return str(text).strip().removeprefix("[").removesuffix("]")


def behind(value: Any, column: int, eol: str, *, in_list: bool) -> str:
    """A value behind a key or a dash in a column: on its line if it fits, else below.

    Args:
        value: The value.
        column: The column of the key or the dash.
        eol: What ends lines.
        in_list: Whether it is behind a dash.
    """
    line = flow_text(value)
    if not (isinstance(value, dict | list) and value and column + len(line) > WIDTH):
        return f" {line}"
    inner = column + INDENT
    start = " " if in_list else eol + " " * inner
    return start + block_text(value, inner, eol)


def block_text(value: dict[Any, Any] | list[Any], column: int, eol: str) -> str:
    """A mapping or list in lines of its own, of which the first is not indented.

    Args:
        value: The mapping or list.
        column: The column in which its lines begin.
        eol: What ends lines.
    """
    if isinstance(value, dict):
        lines = [
            flow_text(key) + ":" + behind(x, column, eol, in_list=False) for key, x in value.items()
        ]
    else:
        lines = ["-" + behind(x, column, eol, in_list=True) for x in value]
    return (eol + " " * column).join(lines)
