"""Read which links of a robot may touch each other: files of MoveIt (SRDF)."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from itertools import combinations
from pathlib import Path as FilePath

from armcontour.core import file_access
from armcontour.core.checks import LONGEST_NAME
from armcontour.core.errors import InvalidInput
from armcontour.core.text import list_some, make_printable, shorten, show
from armcontour.files.robots.tree import MOST_NAMED, parse_xml
from armcontour.robot.scene import LeftOut


def read_left_out(file: str | FilePath, links: Collection[str]) -> tuple[LeftOut, ...]:
    """Read the pairs of links whose distance is not looked at, with the file's reasons.

    A pair may be left out because it was never seen to touch in random postures ("Never") or always
    touched ("Default"): such reasons are kept, so that they can be read.

    Args:
        file: The .srdf file.
        links: Names of links that have shapes; pairs of others are left out of the answer.

    Raises:
        InvalidInput: No such file, another format, a pair without names, or pairs of another robot.
    """
    place = FilePath(file)
    robot = parse_xml(str(place), file_access.read_bytes(place, "SRDF file"))
    if robot.tag != "robot":
        raise InvalidInput(
            f"{place} is not a file of pairs that may touch (SRDF): it holds "
            f"<{robot.tag}>, not <robot>."
        )
    given = [_pair(x, place) for x in robot.findall("disable_collisions")]
    alone = {x.get("link", "") for x in robot.findall("disable_default_collisions")}
    every = {name for x in given for name in (x.first, x.second)} | alone
    if every and not every & set(links):
        raise InvalidInput(
            f"{place} names no link of the arm that has a shape: it is for "
            f"{list_some(sorted(every), MOST_NAMED)}, and the arm has "
            f"{list_some(sorted(set(links)), MOST_NAMED)}."
        )
    enabled = {frozenset(_names(x, place)) for x in robot.findall("enable_collisions")}
    by_default = _with_others(alone, links, f"{place.name}: disable_default_collisions")
    found = {frozenset((x.first, x.second)): x for x in (*by_default, *given)}
    return tuple(x for pair, x in found.items() if pair <= set(links) and pair not in enabled)


def _pair(element: ET.Element, place: FilePath) -> LeftOut:
    """A pair of links, with the reason that the file gives."""
    first, second = _names(element, place)
    reason = shorten(make_printable(element.get("reason", "").strip()), LONGEST_NAME)
    reason = reason or "no reason given"
    return LeftOut(first=first, second=second, reason=f"{place.name}: {reason}")


def _names(element: ET.Element, place: FilePath) -> tuple[str, str]:
    """The two links of an element."""
    first, second = (element.get(key, "").strip() for key in ("link1", "link2"))
    if not first or not second or first == second:
        raise InvalidInput(
            f"{place}: {element.tag} needs two links, link1 and link2, not {show(first)} and "
            f"{show(second)}."
        )
    return first, second


def _with_others(alone: Collection[str], links: Iterable[str], reason: str) -> tuple[LeftOut, ...]:
    """All pairs with some links."""
    return tuple(
        LeftOut(first=first, second=second, reason=reason)
        for first, second in combinations(dict.fromkeys(links), 2)
        if first in alone or second in alone
    )
