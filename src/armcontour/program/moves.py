"""A program: contours, and what comes between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._text import make_printable, shorten
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.geometry import Path
from armcontour.geometry.placing import (
    arc_length_without_z,
    drop_z,
    has_length_without_z,
    lift_path,
    place_path,
)
from armcontour.geometry.segments import REPEATED_POINT

Value = bool | float | str


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that is switched at a place of a contour, or where the tool stands still.

    Args:
        name: What is switched, such as "tool", "spindle", "laser" or "coolant".
        value: What to: on and off are True and False.
        s: Place along the path of its contour [m]; 0 where it is a move of its own.
        lead_time: So much earlier than the tool gets there [s]; later if negative.
        lead_distance: So far before that place along the path [m]; after it if negative.

    Raises:
        InvalidInput: A name or a value that is longer than 80 characters or not printable, or a
            number that is not finite.
    """

    name: str
    value: Value = True
    s: float = 0.0
    lead_time: float = 0.0
    lead_distance: float = 0.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name):
            raise InvalidInput("An event needs a name, which is text.")
        _checks.check_name("name of an event", self.name)
        if isinstance(self.value, str):
            _checks.check_name(f"value of the event {self.name}", self.value)
        elif not isinstance(self.value, bool | np.bool_):
            _checks.number(f"value of the event {self.name}", self.value)
        _checks.not_negative(f"place of the event {self.name}", self.s, "m")
        _checks.number(f"lead time of the event {self.name}", self.lead_time, "s")
        _checks.number(f"lead distance of the event {self.name}", self.lead_distance, "m")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contour:
    """A path along which the process is at work.

    Args:
        path: The path.
        name: What it is called in its source, such as an id or a line number.
        layer: Layer of the drawing that it is on.
        events: What is switched along it, by their places.
        work: Between which places the process is at work [m]; before and after are leads. By
            default all of it.
        keep_start: Whether the drawn start is kept, as in G-code.
        ring: Whether it is closed, where its path with leads and overlap does not tell.

    Raises:
        InvalidInput: No path, a name or a layer that is no name, an event after its end, or work
            that is not within it.
    """

    path: Path
    name: str = ""
    layer: str = ""
    events: tuple[Event, ...] = ()
    work: tuple[float, float] | None = None
    keep_start: bool = False
    ring: bool | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.path, Path):
            raise InvalidInput(f"A contour needs a Path, not {type(self.path).__name__}.")
        _checks.check_name("name of a contour", self.name)
        _checks.check_name("layer of a contour", self.layer)
        if self.work is not None:
            if np.shape(self.work) != (2,):
                raise InvalidInput(
                    f"The work on the contour {self.name} goes from one place to another: give two."
                )
            begin, end = (_checks.number("work of a contour", x, "m") for x in self.work)
            if not -REPEATED_POINT <= begin < end <= self.path.length + REPEATED_POINT:
                raise InvalidInput(
                    f"The work on the contour {self.name} is to go from {begin:g} to {end:g} m, "
                    f"which is not along its {self.path.length:g} m."
                )
        for x in self.events:
            if x.s > self.path.length + REPEATED_POINT:
                raise InvalidInput(
                    f"The event {x.name} is to come at {x.s:g} m of the contour {self.name}, which "
                    f"is {self.path.length:g} m long.",
                    s=x.s,
                    allowed=self.path.length,
                )
        ordered = tuple(sorted(self.events, key=lambda x: x.s))
        object.__setattr__(self, "events", ordered)

    @property
    def closed(self) -> bool:
        """Whether it ends where it starts, leads and overlap apart."""
        if self.ring is not None:
            return self.ring
        ends = self.path([0.0, self.path.length])
        return bool(np.linalg.norm(ends[1] - ends[0]) <= REPEATED_POINT)

    def without_z(self) -> tuple[Contour | Event, ...]:
        """The contour without z; of one of which nothing is left, what is switched there."""
        path, work = self.path, self.work
        if not has_length_without_z(path):
            return tuple(dataclasses.replace(x, s=0.0, lead_distance=0.0) for x in self.events)
        at = partial(arc_length_without_z, path)
        flat = dataclasses.replace(
            self,
            path=drop_z(path),
            events=tuple(dataclasses.replace(x, s=at(x.s)) for x in self.events),
            work=None if work is None else (at(work[0]), at(work[1])),
        )
        return (flat,)


def contour_called(contour: Contour, number: int) -> str:
    """What sentences call a contour: by its name, or by its number, which is counted from 0."""
    if not contour.name:
        return f"contour {number + 1}"
    return contour.name if contour.name.startswith("contour ") else f"contour {contour.name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rapid:
    """A free motion with the tool off, at the arm's limits.

    Args:
        path: What the tool follows; None leaves the way to the joints.

    Raises:
        InvalidInput: Something else than a path.
    """

    path: Path | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.path, Path | None):
            raise InvalidInput(f"A rapid needs a Path or None, not {type(self.path).__name__}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dwell:
    """The tool stands still.

    Args:
        duration: For so long [s].
    """

    duration: float

    def __post_init__(self) -> None:
        _checks.positive("dwell", self.duration, "s")


Move = Contour | Rapid | Dwell | Event


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Program:
    """Moves in order. Where two contours do not meet, a rapid goes from one to the next.

    Args:
        moves: The moves.
        source: What it was made from, such as the name of a file.
        notes: Sentences on what was left out or changed when it was read.

    Raises:
        InvalidInput: No contour, something else than moves, an event between contours that has a
            place, or paths of different dimension.
    """

    moves: tuple[Move, ...]
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "moves", tuple(self.moves))
        # Both repeat names of files and what stands in them, and come to terminals.
        object.__setattr__(self, "source", make_printable(self.source))
        object.__setattr__(self, "notes", tuple(make_printable(shorten(x)) for x in self.notes))
        for x in self.moves:
            if not isinstance(x, Contour | Rapid | Dwell | Event):
                raise InvalidInput(
                    "A program is made of Contours, Rapids, Dwells and Events, not of "
                    f"{type(x).__name__}."
                )
            if isinstance(x, Event) and (x.s or x.lead_distance):
                raise InvalidInput(
                    f"The event {x.name} is a move of its own, where the tool stands still, and "
                    "has no place and no lead distance: give it to a contour, or a lead time."
                )
        if not self.contours:
            raise InvalidInput(f"{self.source or 'A program'} has no contour to follow.")
        paths = (x.path for x in self.moves if isinstance(x, Contour | Rapid))
        if len({x.dimension for x in paths if x is not None}) > 1:
            raise InvalidInput(
                "The contours and rapids of a program must all be in the plane or all in space."
            )

    @classmethod
    def of(cls, path: Path | Program) -> Program:
        """A program as it is; of a path, the program of one contour.

        Args:
            path: Path or program.
        """
        return path if isinstance(path, Program) else cls(moves=(Contour(path=path),))

    @property
    def contours(self) -> tuple[Contour, ...]:
        """The contours, in order."""
        return tuple(x for x in self.moves if isinstance(x, Contour))

    @property
    def path(self) -> Path:
        """The path of its only contour.

        Raises:
            InvalidInput: It has several.
        """
        if len(self.contours) != 1:
            raise InvalidInput(
                f"{self.source or 'The program'} has {len(self.contours)} contours and not one "
                "path: give it as a program, or choose a contour by its layer or name."
            )
        return self.contours[0].path

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.contours[0].path.dimension

    @property
    def length(self) -> float:
        """Length of all contours together [m]."""
        return float(sum(x.path.length for x in self.contours))

    @property
    def breaks(self) -> FloatArray:
        """Arc length of all contours before each contour, and of all [m], (contours + 1,)."""
        lengths = [x.path.length for x in self.contours]
        return np.concatenate([[0.0], np.cumsum(lengths)])

    def mapped(self, change: Callable[[Path], Path]) -> Program:
        """The same with other paths; events keep their share of the length of theirs.

        Args:
            change: Function from the old path of a contour to the new path.
        """
        moves: list[Move] = []
        for x in self.moves:
            if isinstance(x, Contour):
                path = change(x.path)
                factor = path.length / x.path.length
                events = tuple(
                    dataclasses.replace(e, s=min(e.s * factor, path.length)) for e in x.events
                )
                work = None if x.work is None else (x.work[0] * factor, x.work[1] * factor)
                moves.append(dataclasses.replace(x, path=path, events=events, work=work))
            elif isinstance(x, Rapid) and x.path is not None:
                moves.append(Rapid(path=change(x.path)))
            else:
                moves.append(x)
        return dataclasses.replace(self, moves=tuple(moves))

    def oriented(self, rotations: Any, *, axis_only: bool = False) -> Program:
        """The program in space with one tool orientation, as `Path.oriented`.

        Args:
            rotations: Tool axes as columns: a matrix, a quaternion (x, y, z, w) or a rotation of
                scipy.
            axis_only: Only the tool axis counts: the tool may turn about this axis.
        """
        return self.mapped(lambda path: lift_path(path).oriented(rotations, axis_only=axis_only))

    def pointing(self, direction: npt.ArrayLike) -> Program:
        """The program in space with the tool axis in one direction, as `Path.pointing`.

        Args:
            direction: Direction of the tool axis, of any length, (3,).
        """
        return self.mapped(lambda path: lift_path(path).pointing(direction))

    def __repr__(self) -> str:
        """What it is, and not all of its numbers."""
        source = f"{self.source!r}, " if self.source else ""
        return f"Program({source}{len(self.contours)} contours, {self.length:.6g} m)"

    def placed(self, frame: Frame, *, scale: float = 1.0) -> Program:
        """The program drawn in a frame, as seen from where the frame stands.

        Speeds, tolerances and leads stay what they are.

        Args:
            frame: The frame that the program is drawn in.
            scale: Factor of all lengths, before the program is placed.
        """
        return self.mapped(lambda path: place_path(path, frame, scale=scale))

    def without_z(self) -> Program:
        """The program without z; what only goes up and down is left out, but for its events.

        Raises:
            InvalidInput: An arc that stands across the plane.
        """
        moves: list[Move] = []
        number = 0
        for x in self.moves:
            if isinstance(x, Contour):
                called, number = contour_called(x, number), number + 1
                try:
                    moves += x.without_z()
                except InvalidInput as error:
                    said = f"{self.source}: {called}" if self.source else called
                    raise InvalidInput(f"{said}: {error}") from None
            elif not isinstance(x, Rapid) or x.path is None:
                moves.append(x)
            elif has_length_without_z(x.path):
                moves.append(Rapid(path=drop_z(x.path)))
        notes = self.notes
        if any(x.path.orientation is not None for x in self.contours):
            notes = (*notes, "how the tool is held is left out with z.")
        return dataclasses.replace(self, moves=tuple(moves), notes=notes)

    def selected(
        self, *, layers: Collection[str] | None = None, names: Collection[str] | None = None
    ) -> Program:
        """The contours on some layers, or of some names, with free rapids between them.

        Args:
            layers: Names of layers; None takes all.
            names: Names of contours; None takes all.

        Raises:
            InvalidInput: A layer or a name that there is not, or none.
        """
        layers, names = ([x] if isinstance(x, str) else x for x in (layers, names))
        for what, wanted, known in (
            ("layer", layers, {x.layer for x in self.contours}),
            ("contour", names, {x.name for x in self.contours}),
        ):
            if not isinstance(wanted, Collection | None):
                raise InvalidInput(f"A {what} is chosen by its name, not by {wanted!r}.")
            unknown = sorted(set(wanted or ()) - known, key=str)
            if unknown:
                listed = ", ".join(repr(x) for x in sorted(known)[:12])
                raise InvalidInput(
                    f"{self.source or 'The program'} has no {what} {unknown[0]!r}: it has {listed}"
                    f"{', ...' if len(known) > 12 else ''}."
                )
        if layers is None and names is None:
            return self
        kept = tuple(
            x
            for x in self.contours
            if (layers is None or x.layer in layers) and (names is None or x.name in names)
        )
        if not kept:
            why = "fits both the layers and the names" if layers and names else "is chosen"
            raise InvalidInput(
                f"{self.source or 'The program'} has no contour that {why}: leave out the empty "
                "list, or what excludes the other."
            )
        notes = self.notes
        if len(self.contours) < len(self.moves):
            left = "what stood between the chosen contours is left out: rapids, dwells, events."
            notes = (*notes, left)
        return dataclasses.replace(self, moves=kept, notes=notes)
