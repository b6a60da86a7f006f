"""`Program` and its moves: contours, rapids, dwells and events."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.frames import Frame, Pose
from armcontour.core.pictures import Pictured
from armcontour.core.quantities import (
    AtLeast,
    Choice,
    Distance,
    Interval,
    Key,
    Length,
    Name,
    NeededName,
    PlainNumber,
    Rest,
    Speed,
    Time,
)
from armcontour.core.text import list_some, make_printable, shorten
from armcontour.geometry import Path
from armcontour.geometry.origins import describe_origin
from armcontour.geometry.path import arc_lengths_without_z, drop_z, has_length_without_z
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.geometry.weave import Woven

Value = bool | PlainNumber | Name
# Name of the output that changes tools. A number or text selects a tool, like a T word in G-code.
# True and False switch the output on and off.
TOOL = "tool"
# Name of the output for the word S of G-code.
SPINDLE_SPEED = "spindle speed"
# A repeated program has at most this number of moves, and of segments. Planning more takes minutes.
MAX_MOVES = 100_000
MAX_SEGMENTS = 1_000_000
# Places of a wait for an input: with the process off, or right after it is switched on.
AT_START = "start"
SWITCHED_ON = "switched_on"
WAIT_PLACES = (AT_START, SWITCHED_ON)
# Time at rest at a wait [s], which is longer than the dead times of usual controllers.
WAIT_REST = 0.1
Copies = Annotated[int, AtLeast(1, MAX_MOVES)]


@declared()
class Event(Checked):
    """An output that is switched at a position of a contour, or while the tool is at rest.

    >>> laser = ac.Event("laser", True, s=0.01, lead_time=0.02)
    >>> ac.Contour(path=path, events=(laser,)).events[0].name
    'laser'

    Args:
        name: Name of the output, such as "tool", "spindle", "laser" or "coolant".
        value: The new value of the output; True and False are on and off.
        s: Arc length along the path of the contour [m]; 0 for an event between contours.
        lead_time: Time by which the output is switched before the tool reaches s [s]; after it if
            negative.

    Raises:
        InvalidInput: A name or a value is longer than 80 characters or not printable, or a number
            is not finite.
    """

    name: NeededName = field(kw_only=False)
    value: Value = field(default=True, kw_only=False)
    s: Annotated[Distance, Key("at")] = 0.0
    lead_time: Time = 0.0

    @property
    def changes_tool(self) -> bool:
        """True if the event is a tool change, by a number or a name of the tool."""
        return self.name == TOOL and not isinstance(self.value, bool | np.bool_)


@declared(eq=False)
class Contour(Checked):
    """A path along which the process is on.

    >>> contour = ac.Contour(path=path, layer="CUT")
    >>> round(contour.path.length, 4)
    0.059

    Args:
        path: The path.
        name: Name of the contour in its source, such as an id or a line number; empty by default.
        number: Number of the contour in its source, from 1; 0 without a source.
        layer: Layer of the drawing; empty without layers.
        events: Events along the contour, in any order; none by default.
        work: Arc lengths at which the process is switched on and off [m]; leads are before and
            after. By default the whole path.
        keep_start: Whether to keep the drawn start point, as in G-code; false by default.
        ring: Whether the contour is closed, for a path with leads or overlap; None compares the
            ends of the path.
        woven: Seam and parameters of a woven path; None without weaving.
        order: Contours with smaller values run first; 0 by default. The order of the process
            applies to contours with the same value.
        entities: Names of the entities of the drawing that form the contour, for messages; none by
            default.

    Raises:
        InvalidInput: The path is missing, a name or layer is invalid, an event is after the end of
            the path, or the work is outside the path.
    """

    path: Path = field(kw_only=False)
    name: Name = ""
    number: Annotated[int, AtLeast(0)] = 0
    layer: Name = ""
    events: tuple[Event, ...] = ()
    work: tuple[Length, Length] | None = None
    keep_start: bool = False
    ring: bool | None = None
    woven: Woven | None = None
    order: int = 0
    entities: tuple[str, ...] = ()

    def _check_together(self) -> None:
        if self.work is not None:
            start, end = self.work
            if not -REPEATED_POINT <= start < end <= self.path.length + REPEATED_POINT:
                raise InvalidInput(
                    f"The work on the contour {self.name} must increase and lie between 0 and the "
                    f"length of the contour, {self.path.length:g} m, but is from {start:g} to "
                    f"{end:g} m."
                )
        for event in self.events:
            if event.s > self.path.length + REPEATED_POINT:
                raise InvalidInput(
                    f"The event {event.name} is at {event.s:g} m of the contour {self.name}, which "
                    f"is only {self.path.length:g} m long.",
                    s=event.s,
                    allowed=self.path.length,
                )
        ordered = tuple(sorted(self.events, key=lambda x: x.s))
        object.__setattr__(self, "events", ordered)

    @property
    def closed(self) -> bool:
        """True if the contour ends at its start point, without leads and overlap."""
        return self.path.segments.closed if self.ring is None else self.ring

    @property
    def at_work(self) -> tuple[float, float]:
        """Arc lengths at which the process is switched on and off [m], between the leads."""
        return (0.0, self.path.length) if self.work is None else self.work

    @checked
    def origin_at(self, s: Distance) -> str:
        """Name the place in the file that defines the contour at an arc length.

        Examples are "line 12 (N120)" and "LINE handle 2F on layer 'CUT'". Short moves along a line
        become one line, whose place is "lines 12 to 40". The name is empty if the place is unknown,
        as for leads.

        Args:
            s: Arc length [m]. At a vertex, the place is that of the segment before it.
        """
        return origin_on(self.path, s, self.entities)

    def without_z(self) -> tuple[Contour | Event, ...]:
        """Return the contour without z; if no length remains, its events as separate moves."""
        if not has_length_without_z(self.path):
            return tuple(replace(x, s=0.0) for x in self.events)
        return (put_on_path(self, drop_z(self.path), partial(arc_lengths_without_z, self.path)),)


def origin_on(path: Path, s: float, entities: Sequence[str] = ()) -> str:
    """Name the place in the file that defines a path at an arc length, as `Contour.origin_at`.

    - `s`: the arc length [m].
    - `entities`: names of the entities of a drawing, in the order of their numbers on the path.
    """
    # Computed arc lengths of a vertex have rounding errors.
    i = int(path.locate(s - REPEATED_POINT, side="left"))
    return describe_origin(int(path.segments.origins[i]), entities)


def put_on_path(
    contour: Contour, path: Path, map_s: Callable[[FloatArray], FloatArray], **changes: Any
) -> Contour:
    """Move a contour with its events and work to another path.

    - `map_s`: function from arc lengths on the old path to those on the new path [m].
    - `changes`: other fields to change.
    """
    work = () if contour.work is None else contour.work
    old_s = np.array([*(x.s for x in contour.events), *work])
    new_s = np.minimum(map_s(old_s), path.length).tolist()
    events = tuple(replace(x, s=s) for x, s in zip(contour.events, new_s, strict=False))
    new_work = (new_s[-2], new_s[-1]) if work else None
    return replace(contour, path=path, events=events, work=new_work, **changes)


def describe_not_run(layers: Counter[str]) -> tuple[str, ...]:
    """Return a sentence on the layers that are not run, with their counts, if there are any.

    `layers` contains the number of contours, or of drawing entities, per layer.
    """
    listed = list_some(
        [f"{name or 'no layer'} ({n})" for name, n in sorted(layers.items()) if n], 12
    )
    return (f"Layers that are not run: {listed}.",) if listed else ()


def contour_called(contour: Contour, number: int) -> str:
    """Return the name of a contour for messages: its number, and its name if it has one.

    - `number`: index of the contour, whose successor replaces a missing number.
    """
    if contour.name.startswith("contour "):
        return contour.name
    name = f" ({contour.name})" if contour.name else ""
    return f"contour {contour.number or number + 1}{name}"


def name_copy(name: str, row: int, column: int) -> str:
    """Return the name of a contour's copy, which ends with its row and column.

    - `row`, `column`: row and column of the copy, from 0.
    """
    suffix = f"[{row + 1},{column + 1}]"
    return f"{shorten(name, checks.LONGEST_NAME - 1 - len(suffix))} {suffix}" if name else suffix


def _check_spacing(name: str, spacing: float | None, copies: int) -> float:
    """Return the distance between copies [m]; raise InvalidInput if several copies have none."""
    distance = spacing or 0.0
    if copies > 1 and abs(distance) <= REPEATED_POINT:
        raise InvalidInput(
            f"{copies} copies need {name}, the distance from one copy to the next, but it is "
            f"{'missing' if spacing is None else f'{distance:g} m'}."
        )
    return distance if copies > 1 else 0.0


@declared(eq=False)
class Rapid(Checked):
    """A positioning motion with the tool off, at the arm's limits.

    >>> moves = ac.Contour(path=path), ac.Rapid(), ac.Contour(path=path)
    >>> ac.plan(ac.Program(moves=moves), arm, limits).duration > 2 * planned.duration
    True

    Args:
        path: Path of the tool; None moves every joint directly to its target.

    Raises:
        InvalidInput: Neither a path nor None.
    """

    path: Path | None = field(default=None, kw_only=False)


@declared()
class Wait(Checked):
    """A wait for a digital input of the robot before a contour, with the tool at rest.

    Only exported robot programs wait. The plan contains a rest, but not the time of the wait.

    >>> from armcontour.program import Wait
    >>> process = ac.Process(wait=Wait("clamp", within=2.0))
    >>> [type(move).__name__ for move in ac.prepare(path, process).moves]
    ['Dwell', 'Contour']

    Args:
        input: Name of the input, such as "clamp".
        within: Longest time that the robot waits for the input to be on [s]. After this time, the
            program switches its outputs off, shows a message, and ends.
        at: "start" waits with the process off, for a fixture. "switched_on" waits right after the
            process is switched on, for an input that proves it, such as an arc.
        rest: Time at rest in the plan, at the start of which the robot waits [s]: at least two
            cycles, and longer than the time by which set-points lead the tool.
    """

    input: NeededName = field(kw_only=False)
    within: Rest
    at: Annotated[str, Choice(WAIT_PLACES)] = AT_START
    rest: Rest = WAIT_REST


@declared()
class Dwell(Checked):
    """A pause during which the tool is at rest.

    >>> ac.Dwell(0.5).duration
    0.5

    Args:
        duration: The duration [s].
        wait: The wait for an input at the start of the pause; None by default.
    """

    duration: Interval = field(kw_only=False)
    wait: Wait | None = None


Move = Contour | Rapid | Dwell | Event


@declared(eq=False, repr=False)
class Program(Checked, Pictured):
    """Moves in order. The planner adds rapids between contours that do not meet.

    >>> program = ac.Program(moves=(ac.Contour(path=path), ac.Dwell(0.5)))
    >>> len(program.contours), round(program.length, 4)
    (1, 0.059)

    Args:
        moves: The moves.
        source: Origin of the program, such as the name of a file.
        notes: Sentences on parts that were ignored or changed when the program was read; none by
            default.
        remarks: Sentences on automatic choices that need no attention.
        rapid_speed: Largest tool speed of rapids without a path [m/s]; None for the limits of the
            joints only.
        other_layers: Names of the drawing's layers that are not run.
        left_out: The drawing's contours that are not run, if known.
        work_starts: Arc lengths of the whole program, without leads, at which the contours begin
            [m], for a part of a program; empty for a whole program.

    Raises:
        InvalidInput: There is no contour, an object is not a move, an event between contours has an
            arc length or a lead distance, or paths have different dimensions.
    """

    moves: tuple[Move, ...] = field(kw_only=False)
    source: str = ""
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    rapid_speed: Speed | None = None
    other_layers: tuple[str, ...] = ()
    left_out: tuple[Contour, ...] = ()
    work_starts: tuple[Distance, ...] = ()

    def _check_together(self) -> None:
        # These texts come from files and are printed on terminals.
        object.__setattr__(self, "source", make_printable(self.source))
        for name in ("notes", "remarks"):
            texts = tuple(make_printable(shorten(x)) for x in getattr(self, name))
            object.__setattr__(self, name, texts)
        for move in self.moves:
            if isinstance(move, Event) and move.s:
                raise InvalidInput(
                    f"The event {move.name} is a separate move, during which the tool is at rest, "
                    "so it must not have s. Put the event into a contour, or use a lead time."
                )
        if not self.contours:
            raise InvalidInput(f"{self.source or 'A program'} has no contour to follow.")
        paths = (x.path for x in self.moves if isinstance(x, Contour | Rapid))
        if len({x.dimension for x in paths if x is not None}) > 1:
            raise InvalidInput(
                "The contours and rapids of a program must all be in the plane or all in space."
            )

    @classmethod
    @checked
    def from_path(cls, path: Path | Program) -> Program:
        """Make a program of one path and keep its start point; return a program unchanged.

        Args:
            path: The path or the program.

        Raises:
            InvalidInput: Neither a path nor a program.
        """
        if isinstance(path, Program):
            return path
        return cls(moves=(Contour(path=path, number=1, keep_start=True),))

    @property
    def contours(self) -> tuple[Contour, ...]:
        """The contours, in order."""
        return tuple(x for x in self.moves if isinstance(x, Contour))

    @property
    def single_path(self) -> Path | None:
        """The path of a program with one contour, no leads and no events; else None.

        Some options and results are defined for such a program only.
        """
        if len(self.moves) > 1:
            return None
        (only,) = self.contours
        start, end = only.at_work
        whole = start <= REPEATED_POINT and only.path.length - end <= REPEATED_POINT
        return only.path if whole and not only.events else None

    @property
    def path(self) -> Path:
        """The path of the only contour.

        Raises:
            InvalidInput: The program has several contours.
        """
        if len(self.contours) != 1:
            raise InvalidInput(
                f"{self.source or 'The program'} has {len(self.contours)} contours, but one path "
                "is required. Pass the program instead, or select one contour by its layer or name."
            )
        return self.contours[0].path

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point: 2 in the plane, 3 in space."""
        return self.contours[0].path.dimension

    @property
    def length(self) -> float:
        """Total length of all contours [m]."""
        return float(sum(x.path.length for x in self.contours))

    @property
    def work_ranges(self) -> FloatArray:
        """Arc lengths of the whole program, without leads, at which contours start and end [m].

        These are values of `Process.resume_at`, (contours, 2).
        """
        lengths = np.array([end - start for start, end in (x.at_work for x in self.contours)])
        starts = np.cumsum(lengths) - lengths
        if self.work_starts:
            starts = np.array(self.work_starts)
        return np.column_stack([starts, starts + lengths])

    @checked
    def origin_at(self, s: Distance) -> str:
        """Name the place in the file that defines the program at an arc length.

        It is that of the contour, as from `Contour.origin_at`.

        Args:
            s: Arc length over all contours [m], as in `Trajectory.s`.
        """
        breaks = self.breaks
        k = int(checks.locate(breaks, s, "left"))
        return self.contours[k].origin_at(s - float(breaks[k]))

    @property
    def breaks(self) -> FloatArray:
        """Total length before each contour, and of all contours [m], (contours + 1,)."""
        lengths = [x.path.length for x in self.contours]
        return np.concatenate([[0.0], np.cumsum(lengths)])

    @checked
    def mapped(self, change: Callable[[Path], Path]) -> Program:
        """Apply a function to all paths; events stay at the same fraction of the length.

        Args:
            change: Function from an old path to a new path.
        """

        def map_contour(contour: Contour) -> Contour:
            """Return the contour on the changed path."""
            path = change(contour.path)
            checks.check_type("result of change", path, Path)
            scale = partial(np.multiply, path.length / contour.path.length)
            woven = contour.woven and replace(contour.woven, seam=change(contour.woven.seam))
            return put_on_path(contour, path, scale, woven=woven)

        moves: list[Move] = []
        for move in self.moves:
            if isinstance(move, Contour):
                move = map_contour(move)
            elif isinstance(move, Rapid) and move.path is not None:
                move = Rapid(path=change(move.path))
            moves.append(move)
        left_out = tuple(map_contour(x) for x in self.left_out)
        return replace(self, moves=tuple(moves), left_out=left_out)

    def oriented(self, rotations: Any, *, axis_only: bool = False) -> Program:
        """Return the program in space with one tool orientation, as by `Path.oriented`.

        Args:
            rotations: Tool axes as columns: a matrix, a quaternion (x, y, z, w) or a rotation of
                scipy.
            axis_only: Whether only the tool axis is required; rotation about the tool axis is free.
        """
        return self.mapped(lambda path: path.lifted().oriented(rotations, axis_only=axis_only))

    def pointing(self, direction: npt.ArrayLike) -> Program:
        """Return the program in space with the tool axis in one direction, as by `Path.pointing`.

        Args:
            direction: Direction of the tool axis, of any length, (3,).
        """
        return self.mapped(lambda path: path.lifted().pointing(direction))

    def with_cone(self, cone: float) -> Program:
        """Return the program with a cone around its tool axes, as by `Path.with_cone`.

        Args:
            cone: Largest angle between the tool axis and the prescribed one [rad].

        Raises:
            InvalidInput: As in `Path.with_cone`.
        """
        for contour in self.contours:
            contour.path.with_cone(cone)
        # A rapid without tool orientation has it from its contours.
        return self.mapped(lambda x: x if x.orientation is None else x.with_cone(cone))

    def __repr__(self) -> str:
        """Return source, number of contours and length in one line."""
        source = f"{self.source!r}, " if self.source else ""
        return f"Program({source}{len(self.contours)} contours, {self.length:.6g} m)"

    def placed(self, frame: Pose, *, scale: float = 1.0) -> Program:
        """Return the program transformed from a frame to its parent frame.

        Speeds, tolerances and leads stay the same.

        Args:
            frame: The frame of the drawing: a Frame, a 4 by 4 transform, a pinocchio.SE3 or a
                position [m].
            scale: Factor of all lengths, before the program is placed.
        """
        return self.mapped(lambda path: path.placed(frame, scale=scale))

    @checked
    def repeated(
        self,
        *,
        columns: Copies = 1,
        rows: Copies = 1,
        column_spacing: Length | None = None,
        row_spacing: Length | None = None,
    ) -> Program:
        """Copy the whole program in columns along x and rows along y, there and back.

        Rapids, dwells and events are also copied. A contour `hole` becomes `hole [1,1]` (row,
        column), `hole [1,2]`, and so on.

        Args:
            columns: Number of copies along x.
            rows: Number of copies along y.
            column_spacing: Distance from one column to the next [m]; negative in the direction
                opposite to x.
            row_spacing: Distance from one row to the next [m]; negative in the direction opposite
                to y.

        Raises:
            InvalidInput: A spacing is missing or zero, or the copies have too many moves or
                segments.
        """
        dx = _check_spacing("column_spacing", column_spacing, columns)
        dy = _check_spacing("row_spacing", row_spacing, rows)
        self._check_size(columns * rows)
        moves: list[Move] = []
        numbers = itertools.count(1)
        for row in range(rows):
            back = row % 2 == 1
            for column in reversed(range(columns)) if back else range(columns):
                copy = self.placed(Frame(position=np.array([column * dx, row * dy, 0.0])))
                for move in copy.moves:
                    if isinstance(move, Contour):
                        name = name_copy(move.name, row, column)
                        move = replace(move, name=name, number=next(numbers))
                    moves.append(move)
        return replace(self, moves=tuple(moves), left_out=())

    def _check_size(self, copies: int) -> None:
        """Raise InvalidInput if all copies together have too many moves or segments."""
        paths = [x.path for x in self.moves if isinstance(x, Contour | Rapid)]
        segments = sum(len(x) for x in paths if x is not None)
        for noun, count, maximum in (
            ("moves", len(self.moves), MAX_MOVES),
            ("segments", segments, MAX_SEGMENTS),
        ):
            if copies * count > maximum:
                raise InvalidInput(
                    f"{copies} copies of {count} {noun} are more than the maximum of {maximum} "
                    f"{noun}. Specify fewer columns or rows.",
                    needed=copies * count,
                    allowed=maximum,
                )

    def without_z(self) -> Program:
        """Return the program without z. Vertical moves are removed, but their events remain.

        Raises:
            InvalidInput: An arc is not parallel to the plane.
        """
        moves: list[Move] = []
        number = 0
        for move in self.moves:
            if isinstance(move, Contour):
                called = contour_called(move, number)
                number = number + 1
                try:
                    moves += move.without_z()
                except InvalidInput as error:
                    location = f"{self.source}: {called}" if self.source else called
                    raise InvalidInput(f"{location}: {error}") from None
            elif not isinstance(move, Rapid) or move.path is None:
                moves.append(move)
            elif has_length_without_z(move.path):
                moves.append(Rapid(path=drop_z(move.path)))
        notes = self.notes
        if any(x.path.orientation is not None for x in self.contours):
            notes = (*notes, "the tool orientation is removed together with z.")
        return replace(self, moves=tuple(moves), notes=notes, left_out=())

    def selected(
        self, *, layers: Collection[str] | None = None, names: Collection[str] | None = None
    ) -> Program:
        """Select the contours on some layers or with some names, with new rapids between them.

        Args:
            layers: Names of layers; None for all layers.
            names: Names of contours; None for all names.

        Raises:
            InvalidInput: A layer or name does not exist, or no contour remains.
        """
        if layers is None and names is None:
            return self
        by_layer = self._selection_mask("layer", layers, [x.layer for x in self.contours])
        by_name = self._selection_mask("contour", names, [x.name for x in self.contours])
        contours = list[Contour]()
        others = list[Contour]()
        for contour, *chosen in zip(self.contours, by_layer, by_name, strict=True):
            (contours if all(chosen) else others).append(contour)
        if not contours:
            reason = "no contour matches both the layers and the names. Remove one of both lists"
            if layers is None or names is None:
                reason = "no contour is selected. Remove the empty list"
            raise InvalidInput(f"{self.source or 'The program'}: {reason}.")
        notes = self.notes
        if len(self.contours) < len(self.moves):
            note = "rapids, dwells and events between the selected contours are removed."
            notes += (note,)
        unused = Counter(
            x.layer for x, chosen in zip(self.contours, by_layer, strict=True) if not chosen
        )
        return replace(
            self,
            moves=tuple(contours),
            notes=notes,
            remarks=(*self.remarks, *describe_not_run(unused)),
            other_layers=(*self.other_layers, *unused),
            left_out=(*self.left_out, *others),
        )

    def _selection_mask(
        self, kind: str, requested: Collection[str] | None, available: Sequence[str]
    ) -> Sequence[bool]:
        """Return the mask of the contours whose layer or name in `available` is requested."""
        if requested is None:
            return [True] * len(available)
        named = (requested,) if isinstance(requested, str) else requested
        requested = checks.check_names(f"names of a {kind}", named)
        unknown = sorted(set(requested) - set(available), key=str)
        if unknown:
            raise InvalidInput(
                f"{self.source or 'The program'} has no {kind} {unknown[0]!r}, only "
                f"{list_some([repr(x) for x in sorted(set(available))], 12)}."
            )
        return [x in requested for x in available]


def has_intended_start(moves: Sequence[Move], i: int) -> bool:
    """Return whether a rapid, dwell or event precedes contour i and thus fixes its start.

    A dwell or event counts only if it is between this contour and the previous contour.
    """
    for k in range(i - 1, -1, -1):
        if isinstance(moves[k], Rapid):
            return True
        if isinstance(moves[k], Contour):
            return k < i - 1
    return False


def next_rapid(moves: Sequence[Move], order: Iterable[int]) -> int | None:
    """Return the index of the first rapid; None if it has no path or a contour comes before it.

    - `order`: indices of the moves to search, in order.
    """
    for k in order:
        move = moves[k]
        if isinstance(move, Rapid):
            return k if move.path is not None else None
        if isinstance(move, Contour):
            return None
    return None


def events_of(moves: Iterable[Move]) -> Iterator[Event]:
    """Yield all events of moves: along contours, and between moves."""
    for move in moves:
        if isinstance(move, Event):
            yield move
        elif isinstance(move, Contour):
            yield from move.events


def find_departing_rapids(moves: Sequence[Move]) -> set[Rapid]:
    """Find the rapids whose path starts at the end of the previous contour."""
    rapids = set()
    for i, move in enumerate(moves):
        k = next_rapid(moves, range(i + 1, len(moves))) if isinstance(move, Contour) else None
        if k is None or not isinstance(move, Contour):
            continue
        rapid = moves[k]
        assert isinstance(rapid, Rapid) and rapid.path is not None
        if np.linalg.norm(rapid.path(0.0) - move.path(move.path.length)) <= REPEATED_POINT:
            rapids.add(rapid)
    return rapids


def last_end(moves: Sequence[Move]) -> FloatArray | None:
    """Return the end point of the last contour [m]; None without contours."""
    last = next((x.path for x in reversed(moves) if isinstance(x, Contour)), None)
    return None if last is None else last(last.length)


def reroute(
    rapid: Move, *, start: FloatArray | None = None, end: FloatArray | None = None
) -> Rapid:
    """Move the end points of a rapid, because leads and overlaps move the ends of contours.

    A rapid whose points all coincide becomes a joint motion without a path.

    - `start`, `end`: new start and end points [m]; None to keep a point.
    """
    assert isinstance(rapid, Rapid)
    if rapid.path is None:
        return rapid
    vertices = rapid.path.vertices
    first = vertices[0] if start is None else start
    last = vertices[-1] if end is None else end
    moved = np.linalg.norm([first - vertices[0], last - vertices[-1]], axis=1)
    if (moved <= REPEATED_POINT).all():
        return rapid
    if rapid.path.curvatures.any():
        parts = [replace(rapid.path, orientation=None)]
        if np.linalg.norm(vertices[0] - first) > REPEATED_POINT:
            parts.insert(0, Path.polyline((first, vertices[0])))
        if np.linalg.norm(last - vertices[-1]) > REPEATED_POINT:
            parts.append(Path.polyline((vertices[-1], last)))
        return Rapid(path=parts[0].joined(*parts[1:]))
    points = np.array([first, *vertices[1:-1], last])
    if (np.linalg.norm(points - first, axis=1) <= REPEATED_POINT).all():
        return Rapid()
    return Rapid(path=Path.polyline(points))
