"""What the pages show of the newest edit: its plan and its execution."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from threading import Event, Lock
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Step
from armcontour.arms import Arm
from armcontour.errors import ArmContourError, InvalidInput
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.scene import Scene
from armcontour.studio.executed import executed_frame
from armcontour.studio.lanes import FastLane, Stale
from armcontour.studio.picture import drawing_frame, picture_frame
from armcontour.studio.preview import Previewer
from armcontour.studio.previewed import Executed, Preview
from armcontour.studio.refusals import refusal_header
from armcontour.studio.robot import arm_frame
from armcontour.studio.view import View
from armcontour.studio.wire import Frame

# A plan that took longer is executed only when nothing changes any more [s].
QUICK = 0.03
# A longer motion, too [s]: an execution cannot be given up for a newer one.
SHORT = 60.0
# While edits come faster than they are executed, their plans come first for so long [s].
WITHOUT = 0.06
LONG = "the program is long, and is planned when it is at rest."


class Superseded(Exception):
    """Something has changed, so that what was computed is not wanted any more."""


@dataclass(slots=True, eq=False)
class _Seen:
    """What there is of one document: its newest plan and execution, and what pages have of it."""

    planned: Preview | None = None
    executed: Executed | None = None
    # Arm and scene that pages have.
    parts: tuple[Arm, Scene | None] | None = None
    # What the picture on pages shows: a plan, or the path of a run that has none.
    picture: Preview | tuple[Program, str] | None = None
    # Whether pages have anything of its newest state.
    drawn: bool = False


@dataclass(slots=True, eq=False, kw_only=True)
class Shown:
    """A state of the document that is to be shown.

    Args:
        data: The job as parsed.
        run: Name of the run.
        view: How points get on the screen.
        rev: Revision of the document.
        answers: Number of the last message of each tab that is in it, by the tab's number.
        waypoints: Waypoints in the plane [m], (n, 2).
        told: A frame that follows, such as a refusal of the edit that led here.
        moving: Whether a gesture goes on, so that the next state is wanted soon.
    """

    data: Mapping[str, Any]
    run: str
    view: View
    rev: int
    answers: Mapping[int, int]
    waypoints: FloatArray | None = None
    told: Frame | None = None
    moving: bool = False
    # What is seen of its document.
    seen: _Seen = field(default_factory=_Seen, init=False)
    # Whether its plan is drawn, nothing changes any more, and the execution waits for that.
    drawn: bool = field(default=False, init=False)
    rests: bool = field(default=False, init=False)
    waits: bool = field(default=False, init=False)


class Screen:
    """Shows one state after the other; older ones that are not shown yet are left out.

    Args:
        previewer: Plans and executes.
        deliver: Called with each frame, and the state that it belongs to; returns whether pages
            take it, which they do not if the document has changed since.
        lane: Makes the thread that works.
    """

    def __init__(
        self,
        previewer: Previewer,
        deliver: Callable[[Frame, Shown], bool],
        lane: Callable[[Callable[[Frame], None]], FastLane] = FastLane,
    ) -> None:
        self.previewer = previewer
        self._tell = deliver
        self._lock = Lock()
        self._seen = _Seen()
        self._shown: Shown | None = None
        self._working: Shown | None = None
        # Whether pages have the last frame, and an arm of any document.
        self._reached = self._has_arm = False
        # When a plan was executed last [s].
        self._executed_at = -math.inf
        self._done = Event()
        self._lane = lane(self._deliver)

    def wait(self) -> None:
        """Wait until something has been shown."""
        self._done.wait()

    @property
    def planned(self) -> Preview | None:
        """The newest plan of this document."""
        return self._seen.planned

    @property
    def executed(self) -> Executed | None:
        """The newest execution of this document."""
        return self._seen.executed

    @property
    def has_drawn(self) -> bool:
        """Whether pages have a plan of this document, or know why there is none."""
        return self._seen.drawn

    def show(self, shown: Shown) -> None:
        """Show a state, soon."""
        with self._lock:
            self._shown, shown.seen = shown, self._seen
        self._lane.submit(lambda stale: self._frames(shown, stale))

    def rest(self) -> None:
        """Nothing changes any more: what takes longer may be shown, too."""
        with self._lock:
            shown = self._shown
            if shown is None or shown.rests:
                return
            shown.rests = True
            waits = shown.waits
        if waits:
            self._lane.submit(lambda stale: self._frames(shown, stale))

    def pose(self, t: float, of: str) -> FloatArray:
        """Joint positions at a time.

        Args:
            t: The time [s]; before the start and after the end the arm rests.
            of: "planned" or "executed".

        Raises:
            InvalidInput: There is no such motion.
        """
        planned, executed = self.planned, self.executed
        if of == "executed" and executed is not None:
            execution = executed.execution
            return np.array([np.interp(t, execution.t, q) for q in execution.q.T])
        if of != "planned" or planned is None:
            raise InvalidInput(f"There is no motion {of!r} yet.")
        return planned.trajectory(float(np.clip(t, 0.0, planned.trajectory.duration)))

    def forget(self) -> None:
        """Forget what is kept, as another document is opened."""
        with self._lock:
            # What is at work for the other document goes on with what was seen of that.
            self._shown, self._seen = None, _Seen()

    def close(self) -> None:
        """Show nothing any more."""
        self._done.set()
        self._lane.close()

    def _deliver(self, frame: Frame) -> None:
        """Pass a frame on with the state that is worked on, in the lane's thread."""
        assert self._working is not None
        self._reached = self._tell(frame, self._working)
        with self._lock:
            if self._working is self._shown:
                self._working.seen.drawn = True

    def _frames(self, shown: Shown, stale: Stale) -> Iterator[Frame]:
        """All frames of a state."""
        self._working = shown
        yield from self._live(shown, stale)
        if shown.told is not None:
            yield shown.told
        self._done.set()

    def _live(self, shown: Shown, stale: Stale) -> Iterator[Frame]:
        """The plan and its execution, or a refusal."""
        seen, planned = shown.seen, None
        try:
            if not shown.rests and self.previewer.is_long(shown.data):
                yield from self._outline(shown, LONG)
                yield from self._when_at_rest(shown, stale)
                return
            begin = time.perf_counter()
            moving = shown.moving and not shown.rests
            planned = self.previewer.plan(shown.data, shown.run, moving=moving)
            took = time.perf_counter() - begin
            first = not self._has_arm
            if not first:
                yield from self._arm(planned.job, seen)
            seen.planned = planned
            if not shown.drawn:
                shown.drawn = not moving
                yield from self._picture(planned, shown)
            if first:
                # The first plan is wanted before shapes of links, which may take long.
                yield from self._arm(planned.job, seen)
            slow = took > QUICK or planned.trajectory.duration > SHORT
            if slow and self._may_wait(shown):
                return
            yield from self._execution(planned, shown, stale, moving)
        except Superseded:
            pass
        except ArmContourError as error:
            if not isinstance(seen.picture, Preview):
                # What is out of reach can be moved only if it is seen where it is.
                with contextlib.suppress(ArmContourError):
                    if seen.picture != (self.previewer.drawn(shown.data), shown.run):
                        yield from self._outline(shown)
            yield _refusal(error, shown, planned)

    def _execution(
        self, planned: Preview, shown: Shown, stale: Stale, moving: bool
    ) -> Iterator[Frame]:
        """The execution of a plan, and then the exact plan with its own execution."""
        exact = self.previewer.may_be_exact(planned)
        if stale() and time.perf_counter() < self._executed_at + WITHOUT:
            return
        shown.seen.executed = executed = self.previewer.execute(planned, moving=moving)
        self._executed_at = time.perf_counter()
        yield executed_frame(executed, shown.view)
        if (exact or moving) and not stale() and not self._may_wait(shown):
            yield from self._live(shown, stale) if moving else self._exact(shown, stale)

    def _picture(self, planned: Preview, shown: Shown) -> Iterator[Frame]:
        """The picture of a plan."""
        yield picture_frame(planned, shown.view)
        if self._reached:
            shown.seen.picture = planned

    def _outline(self, shown: Shown, note: str = "") -> Iterator[Frame]:
        """The path of a state without a plan.

        Raises:
            ArmContourError: There is no path.
        """
        program = self.previewer.drawn(shown.data)
        yield drawing_frame(program, shown.view, run=shown.run, note=note)
        if self._reached:
            shown.seen.picture = program, shown.run

    def _arm(self, job: Job, seen: _Seen) -> Iterator[Frame]:
        """The arm and what stands in its cell, if pages do not have them."""
        if seen.parts is None or seen.parts[0] is not job.arm or seen.parts[1] != job.scene:
            yield arm_frame(job)
            if self._reached:
                seen.parts, self._has_arm = (job.arm, job.scene), True

    def _exact(self, shown: Shown, stale: Stale) -> Iterator[Frame]:
        """The plan and its execution as a full run has them, unless something changes meanwhile."""
        planned = self._plan_exactly(shown.data, shown.run, stale)
        shown.seen.planned = planned
        yield from self._picture(planned, shown)
        if not stale():
            shown.seen.executed = executed = self.previewer.execute(planned)
            yield executed_frame(executed, shown.view)

    def _plan_exactly(self, data: Mapping[str, Any], run: str, stale: Stale) -> Preview:
        """The plan as a full run has it.

        Raises:
            Superseded: Something has changed meanwhile.
        """

        def go_on(step: Step) -> None:
            if stale():
                raise Superseded

        return self.previewer.plan(data, run, exact=True, progress=go_on)

    def _when_at_rest(self, shown: Shown, stale: Stale) -> Iterator[Frame]:
        """All frames if nothing changes any more; else they come then."""
        if not stale() and not self._may_wait(shown):
            yield from self._live(shown, stale)

    def _may_wait(self, shown: Shown) -> bool:
        """Whether the rest of the work can be left until nothing changes any more."""
        with self._lock:
            shown.waits = not shown.rests
            return shown.waits


def _refusal(error: ArmContourError, shown: Shown, planned: Preview | None) -> Frame:
    """What could not be planned or executed, and where."""
    header = refusal_header(
        error,
        shown.view,
        tier=1 if planned is None else 2,
        run=shown.run,
        planned=planned,
        waypoints=shown.waypoints,
    )
    return Frame("refusal", header)
