"""`Resumption`: the configuration of a whole job, which its remaining part keeps.

`resume_program` (`program/preparation.py`) cuts the program; this module only finds the arm's
configuration at the cut.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number
from armcontour.core.text import list_some
from armcontour.geometry import ShapedPath
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import JointPath
from armcontour.planning import Tracing
from armcontour.planning.program_tracing import TracedWhole
from armcontour.program import Contour, Event, Process, Program
from armcontour.program.corner_rounding import draw_with_arcs
from armcontour.program.execution_choice import MAX_NAMES, chosen_contours
from armcontour.program.moves import Move
from armcontour.program.preparation import find_resumed_place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resumption:
    """Configuration in which a part of a job is executed: its rest, or some of its contours.

    Args:
        resume_at: Arc length at which the job is resumed [m]; 0 if it is not.
        only: Value of `process.only`: the contours that are executed; empty for all.
        begin: Arc length at which the rest begins, before `resume_at` by the part that is processed
            again [m]; None if the whole job has no joint path.
        whole: Joint path of the whole job at this place; None if the whole job has none.
        notes: Notes on the joint path of the whole job, as of `alternatives`.
        reason: Why the whole job has no joint path, as a sentence; empty if it has one.
    """

    resume_at: float
    only: tuple[str, ...] = ()
    begin: float | None = None
    whole: TracedWhole | None = None
    notes: tuple[str, ...] = ()
    reason: str = ""

    @property
    def remark(self) -> str:
        """Note that the configuration of the whole job is kept; empty if it is not."""
        if self.whole is None:
            return ""
        chosen = list_some([repr(x) for x in self.only], MAX_NAMES)
        if not self.resume_at:
            return f"only {chosen} of the whole job, in the configuration of the whole job."
        place = number(self.resume_at, "m")
        if self.begin is not None and self.resume_at - self.begin > REPEATED_POINT:
            overlap = number(self.resume_at - self.begin, "m")
            place = f"{number(self.begin, 'm')}, {overlap} before {place},"
        part = f", only {chosen}," if chosen else ""
        return (
            f"resumed at {place}{part} in the configuration of the whole job, with "
            "its joint positions at this place."
        )

    @property
    def warning(self) -> str:
        """Warning that the whole job has no configuration to keep; empty if it has one."""
        if self.whole is not None:
            return ""
        return (
            "the configuration at the start is chosen for this part of the job, because the whole "
            f"job has no plan: {self.reason} Before you play it, compare its first joint positions "
            "(start) with those of the robot."
        )


def with_marks(objective: Program, number: int, s: FloatArray) -> Program:
    """Return the program with events at places of a contour, which loses its other events.

    Rounding and drawing with arcs keep the events at their places, so that `marked_places` finds
    the places on the changed contour.

    - `number`: index of the contour.
    - `s`: increasing arc lengths on the contour [m], (n,).
    """
    index = 0
    moves = list[Move]()
    for move in objective.moves:
        if isinstance(move, Contour):
            if index == number:
                events = tuple(Event(name="place", s=float(x)) for x in s)
                move = replace(move, events=events)
            index += 1
        moves.append(move)
    return replace(objective, moves=tuple(moves))


def marked_places(contour: Contour) -> FloatArray:
    """Return the arc lengths of a marked contour's events [m], (n,)."""
    return np.array([x.s for x in contour.events])


def shaped_places(objective: Program, path: Program, number: int, s: FloatArray) -> FloatArray:
    """Find places of a drawn contour on its shaped contour; return their arc lengths [m], (n,).

    - `objective`: the program with sharp corners.
    - `path`: the program with shaped corners.
    - `number`: index of the contour.
    - `s`: increasing arc lengths on the drawn contour [m], (n,).
    """
    drawn = draw_with_arcs(with_marks(objective, number, s).contours[number])
    shaped = path.contours[number].path
    assert isinstance(shaped, ShapedPath)
    return shaped.place(marked_places(drawn))


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumedPlace:
    """Place at which a whole job is resumed.

    Args:
        number: Index of the contour in the program.
        s: Arc length of the contour, with its lead-in and sharp corners [m].
        begin: Arc length over all contours, without leads [m].
        chosen: Indices of the contours that are executed after it, if `process.only` leaves out
            contours; None if all contours follow, as in the whole job.
    """

    number: int
    s: float
    begin: float
    chosen: tuple[int, ...] | None = None

    @classmethod
    def find(cls, objective: Program, process: Process) -> ResumedPlace | None:
        """Find the place in the prepared program of the whole job; None if no work is left.

        `process`: the process that resumes the job, or chooses contours.
        """
        works = [contour.at_work for contour in objective.contours]
        # Arc lengths over all contours, without leads, at which the contours start and end.
        breaks = np.cumsum([0.0, *(end - start for start, end in works)])
        number, s = find_resumed_place(breaks, process)
        if number >= len(works):
            return None
        chosen: tuple[int, ...] | None = None
        if process.only:
            is_chosen = chosen_contours(objective.contours, process.only)
            left = [i for i, x in enumerate(is_chosen) if x and i >= number]
            if not left:
                return None
            if left[0] > number:
                s = 0.0
            number, *others = left
            chosen = tuple(others)
        start, end = works[number]
        return cls(
            number=number,
            s=min(start + s, end),
            begin=float(breaks[number]) + s,
            chosen=chosen,
        )

    def traced(self, tracing: Tracing, s: float) -> TracedWhole:
        """Return the joint path of the whole contour at the place, and those of the later moves.

        - `tracing`: joint paths of the whole job.
        -         `s`: arc length of the place on the contour with rounded or shaped corners [m].
        """
        moves = tracing.program.moves
        indices = [i for i, move in enumerate(moves) if isinstance(move, Contour)]
        index = indices[self.number]
        paths = {x.move: x.joint_path for x in tracing.steps if x.joint_path is not None}
        joint_path = paths[index]
        s = min(s, joint_path.length)
        rapid = list[JointPath]()
        for step in tracing.steps:
            if step.move == index:
                break
            if tracing.is_contour(step):
                rapid = []
            elif step.joint_path is not None:
                rapid.append(step.joint_path)
        if self.chosen is not None:
            contours = tracing.program.contours
            chosen = tuple(
                TracedWhole(joint_path=paths[indices[k]], s=contours[k].at_work[0], later={})
                for k in self.chosen
            )
            return TracedWhole(
                joint_path=joint_path, s=s, later={}, chosen=chosen, rapid=tuple(rapid)
            )
        # The cut removes moves from the start, so that later moves are counted from the end.
        later = {len(moves) - i: x for i, x in paths.items() if i is not None and i > index}
        return TracedWhole(joint_path=joint_path, s=s, later=later, rapid=tuple(rapid))
