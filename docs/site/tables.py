"""Pieces of Markdown that written pages have in common."""

from __future__ import annotations

import re
from collections.abc import Iterable

OPTION = re.compile(r"(?<![\w`-])--[a-z][\w-]*")


def table(*heads: str, rows: Iterable[str]) -> str:
    """A table.

    Args:
        *heads: Titles of the columns.
        rows: Lines of it, each with all its bars.
    """
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows]) + "\n"


def cell(text: str | None) -> str:
    """A text in a cell of a table; options in it are code."""
    return OPTION.sub(r"`\g<0>`", " ".join((text or "").replace("|", r"\|").split()))


def contents(names: Iterable[str]) -> str:
    """The pages below a page, for its place in the navigation."""
    return "\n```{toctree}\n:hidden:\n\n" + "\n".join(names) + "\n```\n"
