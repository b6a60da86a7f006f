"""Places of errors about a move: its name, and the place in the file that defines its path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from armcontour.core.errors import ArmContourError
from armcontour.geometry import Path
from armcontour.program.moves import origin_on


@contextmanager
def move_context(called: str, path: Path | None, entities: Sequence[str] = ()) -> Iterator[None]:
    """Add the name of a move, and the place on its path, to errors in this context.

    - `called`: name of the move; empty for a single path.
    - `path`: path of the tool, to which the arc lengths of the errors belong; None without one.
    - `entities`: names of the entities of a drawing, in the order of their numbers on the path.
    """
    try:
        yield
    except ArmContourError as error:
        origin = ""
        point = error.point
        if path is not None and error.s is not None:
            s = min(max(error.s, 0.0), path.length)
            origin = origin_on(path, s, entities)
            point = point or tuple(path(s).tolist())
        # A contour of G-code has the name of its first line.
        is_named = bool(origin) and called.endswith(f"({origin})")
        location = called if is_named else ", ".join(filter(None, (called, origin)))
        located = error.with_location(location) if location else error
        located.point = point
        located.origin = origin or error.origin
        raise located.with_traceback(error.__traceback__) from None
