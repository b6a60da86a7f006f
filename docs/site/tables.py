"""Markdown that generated pages share."""

from __future__ import annotations

import re
from collections.abc import Iterable

OPTION = re.compile(r"(?<![\w`-])--[a-z][\w-]*")


def table(*heads: str, rows: Iterable[str]) -> str:
    """Return a table.

    Args:
        *heads: Titles of the columns.
        rows: Rows in Markdown, such as `| a | b |`.
    """
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows]) + "\n"


def cell(text: str | None) -> str:
    """Return a text as a cell of a table, with options as code."""
    return OPTION.sub(r"`\g<0>`", " ".join((text or "").replace("|", r"\|").split()))


def contents(names: Iterable[str]) -> str:
    """Return the toctree of the pages below a page."""
    return "\n```{toctree}\n:hidden:\n\n" + "\n".join(names) + "\n```\n"
