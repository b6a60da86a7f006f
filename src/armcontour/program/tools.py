"""Tools of a program, and the contours of each tool."""

from __future__ import annotations

from dataclasses import replace

from armcontour.core.errors import InvalidInput
from armcontour.program.moves import Contour, Event, Move, Program, Value


def tool_name(value: Value) -> str:
    """Name of a tool from the value of its event; `T2` for the number 2."""
    return value if isinstance(value, str) else f"T{value:g}"


def tools_of_contours(program: Program) -> list[str]:
    """Name of the tool of each contour, in order; "" before the first tool change."""
    tool, names = "", []
    for move in program.moves:
        if isinstance(move, Event) and move.changes_tool:
            tool = tool_name(move.value)
        elif isinstance(move, Contour):
            names.append(tool)
    return names


def part_of_tool(program: Program, name: str) -> Program:
    """All parts of a program from a change to a tool until the next tool change."""
    # At the start of each part, the last events of the skipped moves are repeated, so outputs have
    # the same values as in the whole program.
    # `name`: name of the tool, such as T2.
    names = tools_of_contours(program)
    if name not in names:
        available = ", ".join(dict.fromkeys(x for x in names if x)) or "no tool"
        raise InvalidInput(
            f"{program.source or 'The program'} has no contour of the tool {name}, only of "
            f"{available}."
        )
    tool, moves = "", list[Move]()
    states: dict[str, Event] = {}
    for move in program.moves:
        if isinstance(move, Event) and move.changes_tool:
            tool = tool_name(move.value)
            if tool == name:
                moves += [*states.values(), move]
                states = {}
        elif tool == name:
            moves.append(move)
        else:
            events = move.events if isinstance(move, Contour) else (move,)
            output_events = (y for y in events if isinstance(y, Event))
            states |= {
                y.name: replace(y, s=0.0, lead_time=0.0, lead_distance=0.0) for y in output_events
            }
    return replace(program, moves=tuple(moves))
