"""`process.only`: which contours of a prepared program are executed, and the moves between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.guesses import suggest
from armcontour.core.text import list_some
from armcontour.geometry import Path
from armcontour.geometry.path import cut_path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.moves import (
    Contour,
    Dwell,
    Event,
    Move,
    Program,
    Rapid,
    Value,
    contour_called,
    events_of,
)

# Words before a name or a number that belongs to a layer as well as to a contour.
CONTOUR_PREFIX = "contour "
LAYER_PREFIX = "layer "
# Maximum number of names in a message.
MAX_NAMES = 12


def chosen_contours(contours: Sequence[Contour], only: Sequence[str]) -> list[bool]:
    """Return whether each contour is executed.

    Args:
        contours: The contours in the order of execution; every pass of an open contour is one.
        only: Names of contours, their numbers, or layers; empty for all contours.

    Raises:
        InvalidInput: A name does not exist, or is that of a contour and of another layer.
    """
    if not only:
        return [True] * len(contours)
    chosen = [False] * len(contours)
    for text in only:
        found = _find(contours, text)
        chosen = [x or y for x, y in zip(chosen, found, strict=True)]
    return chosen


def _find(contours: Sequence[Contour], text: str) -> list[bool]:
    """Return whether each contour has this name, number or layer; at least one has."""
    layers = [x.layer == text for x in contours]
    own = _named(contours, text)
    if any(own) and any(layers) and own != layers:
        raise InvalidInput(
            f"only has {text!r}, which is a layer and also the name or number of a "
            f"contour. Write '{CONTOUR_PREFIX}{text}' or '{LAYER_PREFIX}{text}'.",
            key=("process", "only"),
        )
    found = own if any(own) else layers
    if not any(found) and text.startswith(CONTOUR_PREFIX):
        found = _named(contours, text.removeprefix(CONTOUR_PREFIX))
    if not any(found) and text.startswith(LAYER_PREFIX):
        found = [x.layer == text.removeprefix(LAYER_PREFIX) for x in contours]
    if not any(found):
        raise InvalidInput(
            f"only has {text!r}, but no contour has this name, number or layer"
            f"{_existing(contours, text)}.",
            key=("process", "only"),
        )
    return found


def _named(contours: Sequence[Contour], text: str) -> list[bool]:
    """Return whether each contour has this name, or else this number.

    All passes of an open contour have the name of the first one, and its number.
    """
    numbers = [x.number or i + 1 for i, x in enumerate(contours)]
    first_names = dict[int, str]()
    for number, contour in zip(numbers, contours, strict=True):
        first_names.setdefault(number, contour.name)
    named = [
        text in (contour.name, first_names[number], contour_called(contour, i))
        for i, (number, contour) in enumerate(zip(numbers, contours, strict=True))
    ]
    if any(named):
        return named
    return [text == str(number) for number in numbers]


def _existing(contours: Sequence[Contour], text: str) -> str:
    """Return the clause that lists the names that exist, the most similar one first."""
    names = dict.fromkeys(x.name for x in contours if x.name)
    layers = dict.fromkeys(x.layer for x in contours if x.layer)
    meant = suggest(text, [*names, *layers], "")
    clauses = []
    if meant:
        clauses.append(meant.removesuffix("?").replace("did you mean", "perhaps you mean"))
    count = len({x.number or i + 1 for i, x in enumerate(contours)})
    clauses.append(f"the numbers are 1 to {count}")
    if names:
        clauses.append(f"the names are {list_some(list(names), MAX_NAMES)}")
    if layers:
        clauses.append(f"the layers are {list_some(list(layers), MAX_NAMES)}")
    return f": {', '.join(clauses)}"


def leave_out(
    program: Program, chosen: Sequence[bool], up: FloatArray, departing_rapids: set[Rapid]
) -> Program:
    """Return the program without some contours.

    Where contours are left out, the tool follows the rapid away from the last executed contour up
    to its highest point, crosses at the height of the highest rapid that is left out, and follows
    the rapid to the next contour from its highest point. Outputs get the values that they have
    there in the whole program.

    Args:
        program: The program, whose contours have their start points, without leads.
        chosen: Whether each contour is executed.
        up: Upward direction in space, (3,).
        departing_rapids: Rapids that start at the end of the contour before them; shortened rapids
            are added.
    """
    moves = list[Move]()
    values = dict[str, Value]()
    last: Contour | None = None
    # Moves since the last contour that is executed.
    between = list[Move]()
    is_chosen = iter(chosen)
    for move in program.moves:
        if not isinstance(move, Contour) or not next(is_chosen):
            between.append(move)
            continue
        if any(isinstance(x, Contour) for x in between):
            between = _shortened(between, last, move, up, values, departing_rapids)
        moves += [*between, move]
        values |= {x.name: x.value for x in events_of([*between, move])}
        between = []
        last = move
    if any(isinstance(x, Contour) for x in between):
        between = _shortened(between, last, None, up, values, departing_rapids)
    kept_starts = [x for x, y in zip(program.work_starts, chosen, strict=True) if y]
    return replace(program, moves=(*moves, *between), work_starts=tuple(kept_starts))


def _shortened(
    between: Sequence[Move],
    last: Contour | None,
    following: Contour | None,
    up: FloatArray,
    values: dict[str, Value],
    departing_rapids: set[Rapid],
) -> list[Move]:
    """Return the moves between two executed contours, without the contours that are left out.

    - `last`, `following`: the two contours; None before the first and after the last one.
    - `values`: values of the outputs after `last`.
    """
    outputs = _outputs(between, values)
    if following is None:
        outputs = [x for x in outputs if not (isinstance(x, Event) and x.changes_tool)]
    paths = [x.path for x in between if isinstance(x, Rapid) and x.path is not None]
    if not paths:
        return outputs
    leaving = [] if last is None else _leaving(between, up, departing_rapids)
    arriving = [] if following is None else _arriving(between, up)
    crossing = [_end_of(leaving, last), _start_of(arriving, following)]
    way = _crossing(crossing[0], crossing[1], paths, up)
    if way and last is not None and not leaving:
        departing_rapids.add(way[0])
    return [*leaving, *outputs, *way, *arriving]


def _end_of(rapids: Sequence[Rapid], contour: Contour | None) -> FloatArray | None:
    """Return where rapids after a contour end [m]."""
    if rapids and rapids[-1].path is not None:
        return rapids[-1].path.end
    return None if contour is None else contour.path.end


def _start_of(rapids: Sequence[Rapid], contour: Contour | None) -> FloatArray | None:
    """Return where rapids before a contour start [m]."""
    if rapids and rapids[0].path is not None:
        return rapids[0].path.start
    return None if contour is None else contour.path.start


def _crossing(
    begin: FloatArray | None, end: FloatArray | None, paths: Sequence[Path], up: FloatArray
) -> list[Rapid]:
    """Return the rapid between two points: up, across at the height of the others, and down.

    - `begin`, `end`: the points [m]; None for no way to or from there.
    - `paths`: paths of the rapids in the whole program, whose highest point is crossed at.
    """
    points = list[FloatArray]()
    if paths[0].dimension == 2:
        points = [x for x in (begin, end) if x is not None]
    else:
        top = max(float((x.vertices @ up).max()) for x in paths)
        if begin is not None:
            points += [begin, begin + max(top - float(begin @ up), 0.0) * up]
        if end is not None:
            points += [end + max(top - float(end @ up), 0.0) * up, end]
    corners = points[:1]
    for point in points[1:]:
        if np.linalg.norm(point - corners[-1]) > REPEATED_POINT:
            corners.append(point)
    return [Rapid(path=Path.polyline(corners))] if len(corners) > 1 else []


def _outputs(moves: Sequence[Move], values: dict[str, Value]) -> list[Move]:
    """Return what switches the outputs as moves that are left out do, and a dwell after it.

    - `values`: values of the outputs before these moves.
    """
    last = {x.name: replace(x, s=0.0, lead_time=0.0) for x in events_of(moves)}
    switched: list[Move] = [x for x in last.values() if values.get(x.name, False) != x.value]
    dwells = [x.duration for x in moves if isinstance(x, Dwell)]
    if switched and dwells:
        # Such as the time that a spindle needs.
        switched.append(Dwell(duration=max(dwells)))
    return switched


def _leaving(moves: Sequence[Move], up: FloatArray, departing_rapids: set[Rapid]) -> list[Rapid]:
    """Return the rapids away from a contour up to their highest point.

    - `moves`: moves after the contour, with the contours that are left out.
    """
    rapids = _rapids_until_contour(moves)
    heights = [_heights(x, up) for x in rapids]
    top = max((float(x.max()) for x in heights), default=0.0)
    if not rapids or top <= heights[0][0] + REPEATED_POINT:
        return []
    kept = list[Rapid]()
    for rapid, height in zip(rapids, heights, strict=True):
        if height.max() < top - REPEATED_POINT:
            kept.append(rapid)
            continue
        assert rapid.path is not None
        k = int(np.argmax(height >= top - REPEATED_POINT))
        if k:
            rest = Rapid(path=cut_path(rapid.path, 0.0, float(rapid.path.breaks[k])))
            if rapid in departing_rapids:
                departing_rapids.add(rest)
            kept.append(rest)
        break
    return kept


def _arriving(moves: Sequence[Move], up: FloatArray) -> list[Rapid]:
    """Return the rapids to a contour from their highest point.

    - `moves`: moves before the contour, with the contours that are left out.
    """
    rapids = _rapids_until_contour(moves[::-1])
    turned = [Rapid(path=x.path.reversed()) for x in rapids if x.path is not None]
    back = _leaving(turned, up, set())
    return [Rapid(path=x.path.reversed()) for x in back[::-1] if x.path is not None]


def _rapids_until_contour(moves: Iterable[Move]) -> list[Rapid]:
    """Return the rapids with a path before the first contour; empty in the plane."""
    rapids = list[Rapid]()
    for move in moves:
        if isinstance(move, Contour):
            break
        if isinstance(move, Rapid) and move.path is not None and move.path.dimension == 3:
            rapids.append(move)
    return rapids


def _heights(rapid: Rapid, up: FloatArray) -> FloatArray:
    """Return the heights of the vertices of a rapid [m], (n,)."""
    assert rapid.path is not None
    return np.asarray(rapid.path.vertices @ up)
