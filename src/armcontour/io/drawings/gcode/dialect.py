"""Properties of a whole program that change the meaning of single words."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from armcontour.io.drawings.gcode.words import COMMENTS, LONGEST_LINE

TOOL_CHANGE = re.compile(r"[mM][ \t]*0*6(?![0-9.])")
# A move with a word E, which feeds material.
EXTRUSION = re.compile(r"[gG]0?[123](?![0-9.])[^mM;(]*(?<![a-zA-Z])[eE]-?[0-9.]")
# Codes that only programs of printers have: modes of E, and temperatures of nozzle and bed.
PRINTER = re.compile(r"[mM](?:8[23]|1[04][49]|140|190)(?![0-9.])")


@dataclass(frozen=True, slots=True)
class Dialect:
    """Properties of a whole program.

    Attributes:
        changes_tools: Whether it has M6; otherwise T alone changes the tool.
        extrudes: Whether some move feeds material.
        printer: Whether it is a printer's, in which G4 P is in milliseconds.
    """

    changes_tools: bool
    extrudes: bool
    printer: bool


def dialect_of(lines: list[str]) -> Dialect:
    """The dialect of a program."""
    extrudes = _has(EXTRUSION, (x for x in lines if "E" in x or "e" in x))
    return Dialect(
        changes_tools=_has(TOOL_CHANGE, (x for x in lines if "6" in x)),
        extrudes=extrudes,
        printer=extrudes or _has(PRINTER, (x for x in lines if "M" in x or "m" in x)),
    )


def _has(pattern: re.Pattern[str], lines: Iterable[str]) -> bool:
    """Whether a pattern occurs in a line, outside of comments."""
    return any(
        pattern.search(COMMENTS.sub("", x)) is not None for x in lines if len(x) <= LONGEST_LINE
    )
