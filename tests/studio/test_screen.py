"""What is shown while a person edits, and when nothing changes any more."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from importlib import resources
from typing import Any

import pytest

import armcontour as ac
from armcontour._yaml import load
from armcontour.io import parse_job
from armcontour.studio.handles import handles_of
from armcontour.studio.preview import Previewer
from armcontour.studio.screen import Screen, Shown
from armcontour.studio.view import View
from armcontour.studio.wire import Frame

PAPER = (resources.files("armcontour.jobs") / "library" / "paper.yaml").read_text("utf-8")
PATIENCE = 60.0
pytestmark = pytest.mark.usefixtures("no_hurry")


class Heard:
    """Frames of a screen, which can be waited for."""

    def __init__(self) -> None:
        self.frames: list[tuple[Frame, Shown]] = []
        # States that the document has left before pages could have them.
        self.late: list[Shown] = []
        self._news = threading.Condition()

    def __call__(self, frame: Frame, shown: Shown) -> bool:
        with self._news:
            self.frames.append((frame, shown))
            self._news.notify_all()
        return shown not in self.late

    def wait(self, is_it: Callable[[list[tuple[Frame, Shown]]], bool]) -> None:
        with self._news:
            assert self._news.wait_for(lambda: is_it(self.frames), PATIENCE)

    def of(self, kind: str, shown: Shown) -> list[Frame]:
        return [frame for frame, y in self.frames if frame.kind == kind and y is shown]


@contextmanager
def showing(previewer: Previewer) -> Iterator[tuple[Screen, Heard]]:
    heard = Heard()
    screen = Screen(previewer, heard)
    try:
        yield screen, heard
    finally:
        screen.close()


def shown(
    previewer: Previewer, data: Mapping[str, Any], run: str, *, moving: bool = False
) -> Shown:
    handles = handles_of(previewer.job(data, run), data)
    view = View(handles.plane, handles.centre)
    return Shown(data=data, run=run, view=view, rev=0, answers={}, moving=moving)


@pytest.mark.parametrize("run", ["optimal", "shaped"])
def test_at_rest_the_picture_is_that_of_a_full_run(run: str) -> None:
    data, previewer = load(PAPER, "job"), Previewer()
    want = ac.run(parse_job(_only(run))).runs[run].evaluation
    with showing(previewer) as (screen, heard):
        state = shown(previewer, data, run)
        screen.show(state)
        heard.wait(lambda frames: any(x.kind == "executed" for x, _ in frames))
        assert heard.of("executed", state)[-1].header["rms"] != want.contour_error.rms
        screen.rest()
        heard.wait(lambda frames: len(heard.of("picture", state)) == 2)
        assert heard.of("picture", state)[-1].header["duration"] == want.duration
        heard.wait(lambda frames: frames[-1][0].header.get("rms") == want.contour_error.rms)


def test_what_moves_is_planned_on_a_coarser_grid_until_it_rests() -> None:
    data, previewer = load(PAPER.replace("interval: 0.2 ms", "interval: 4 ms"), "job"), Previewer()
    fine = previewer.plan(data, "optimal").trajectory
    with showing(previewer) as (screen, heard):
        state = shown(previewer, data, "optimal", moving=True)
        screen.show(state)
        heard.wait(lambda frames: bool(heard.of("executed", state)))
        (coarse,) = heard.of("picture", state)
        assert coarse.header["duration"] == pytest.approx(fine.duration, rel=1e-3)
        assert coarse.header["duration"] != fine.duration
        assert any("600 intervals" in x for x in coarse.header["notes"])
        screen.rest()
        heard.wait(lambda frames: len(heard.of("executed", state)) == 2)
        assert heard.of("picture", state)[-1].header["duration"] == fine.duration
        assert not heard.of("picture", state)[-1].header["notes"]


@pytest.mark.parametrize(("without", "executed"), [(0.0, [0, 1, 2, 3]), (1e9, [0, 3])])
def test_while_newer_edits_wait_plans_come_first_for_a_while(
    without: float, executed: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armcontour.studio.screen.WITHOUT", without)
    data, previewer = load(PAPER, "job"), Previewer()
    states = [
        shown(previewer, {**data, "limits": {**data["limits"], "speed": speed}}, "optimal")
        for speed in (0.05, 0.06, 0.07, 0.08)
    ]
    heard = Heard()

    def hear(frame: Frame, state: Shown) -> None:
        k = states.index(state)
        # The next edit comes with the plan of the one before.
        if frame.kind == "picture" and k < 3:
            screen.show(states[k + 1])
        heard(frame, state)

    with closing(Screen(previewer, hear)) as screen:
        screen.show(states[0])
        heard.wait(lambda frames: bool(heard.of("executed", states[3])))
    assert all(heard.of("picture", x) for x in states)
    assert [k for k, x in enumerate(states) if heard.of("executed", x)] == executed


def test_at_rest_what_is_compared_is_as_exact_as_what_is_shown() -> None:
    data, previewer = load(PAPER, "job"), Previewer()
    with showing(previewer) as (screen, heard):
        screen.compare(data, "optimal")
        state = shown(previewer, data, "optimal")
        screen.show(state)
        heard.wait(lambda frames: len(heard.of("executed", state)) == 2)
        rough = heard.of("executed", state)[-1]
        screen.rest()
        heard.wait(lambda frames: len(heard.of("executed", state)) == 5)
        *_, live, beside = heard.of("executed", state)
        assert [live.header["of"], beside.header["of"]] == ["live", "compare"]
        for figure in ("rms", "max"):
            assert live.header[figure] == beside.header[figure] != rough.header[figure]


def test_what_changes_ends_the_search_for_the_picture_of_a_full_run() -> None:
    data, previewer = load(PAPER, "job"), Previewer()
    with showing(previewer) as (screen, heard):
        first, second = (shown(previewer, data, x) for x in ("shaped", "optimal"))
        screen.show(first)
        heard.wait(lambda frames: any(x.kind == "executed" for x, _ in frames))
        screen.rest()
        screen.show(second)
        heard.wait(lambda frames: bool(heard.of("executed", second)))
        # The shape of the first is not drawn after the second.
        order = [y is second for _, y in heard.frames]
        assert order == sorted(order)


def _only(run: str) -> str:
    """The paper's job with one run, and without the experiment."""
    from armcontour.io.job_edits import Change, change_text

    others = [x for x in load(PAPER, "job")["runs"] if x != run]
    changes = [Change(("runs", x)) for x in others]
    return change_text(PAPER, [*changes, Change(("experiment",)), Change(("published",))], "job")


def test_the_first_plan_comes_before_the_arm_and_a_changed_arm_before_its_plan() -> None:
    previewer, data = Previewer(), load(PAPER, "paper")
    with showing(previewer) as (screen, heard):
        assert not screen.has_drawn
        first, second = (
            shown(previewer, {**data, "arm": arm}, "optimal", moving=True)
            for arm in ("pmk3s", {"name": "pmk3s"})
        )
        for x in (first, second):
            screen.show(x)
            heard.wait(lambda frames, x=x: bool(heard.of("executed", x)))  # type: ignore[misc]
        assert screen.has_drawn
        kinds = [[y.kind for y, of in heard.frames if of is x][:2] for x in (first, second)]
        assert kinds == [["picture", "arm"], ["arm", "picture"]]


def test_a_path_that_cannot_be_planned_is_drawn_before_it_is_refused() -> None:
    previewer, data = Previewer(), load(PAPER, "paper")
    away = {**data, "path": {"points": [[0.35, 0.1], [0.9, 0.1]]}}
    with showing(previewer) as (screen, heard):
        for again in (False, True):
            if again:
                # Another document, of which nothing is seen yet.
                screen.forget()
            x, y = (shown(previewer, away, "optimal") for _ in range(2))
            for state in (x, y):
                screen.show(state)
                heard.wait(lambda frames, state=state: bool(heard.of("refusal", state)))  # type: ignore[misc]
            (drawn,) = heard.of("picture", x)
            assert drawn.header["planned"] is False and not drawn.header["notes"]
            assert not heard.of("picture", y)


def test_a_path_that_is_refused_is_drawn_where_it_is_until_there_is_a_motion() -> None:
    previewer, data = Previewer(), load(PAPER, "paper")

    def through(x: float, **more: Any) -> Shown:
        path = {"points": [[0.35, 0.1], [x, 0.1]], **more}
        return shown(previewer, {**data, "path": path}, "optimal")

    with showing(previewer) as (screen, heard):
        there, placed = through(0.9), through(0.9, frame={"position": [0.0, 0.1, 0.0]})
        states = [there, placed, through(1.2), through(0.45), through(0.9)]
        for state in states:
            screen.show(state)
            heard.wait(
                lambda frames, state=state: (  # type: ignore[misc]
                    bool(heard.of("refusal", state) or heard.of("executed", state))
                )
            )
        outlines = [heard.of("picture", x) for x in states]
        assert [[y.header.get("planned", True) for y in x] for x in outlines] == [
            *([False], [False], [False]),
            [True],
            # The last motion stays.
            [],
        ]


class Opening(Previewer):
    """A previewer during whose first plan another document is opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: Callable[[], None] = lambda: None

    def plan(self, *job: Any, **options: Any) -> Any:
        planned = super().plan(*job, **options)
        self.open()
        return planned


def test_a_plan_of_the_document_before_is_none_of_this_one() -> None:
    previewer, data = Opening(), load(PAPER, "paper")
    away = {**data, "path": {"points": [[0.35, 0.1], [0.9, 0.1]]}}
    with showing(previewer) as (screen, heard):
        old, new = (shown(previewer, x, "optimal") for x in (data, away))

        def forget() -> None:
            heard.late.append(old)
            screen.forget()

        previewer.open = forget
        screen.show(old)
        heard.wait(lambda frames: bool(heard.of("executed", old)))
        assert screen.planned is None and screen.executed is None and not screen.has_drawn
        with pytest.raises(ac.InvalidInput, match="no motion 'planned' yet"):
            screen.pose(0.0, "planned")
        previewer.open = lambda: None
        screen.show(new)
        heard.wait(lambda frames: bool(heard.of("refusal", new)))
        # Of this document there is no motion that could stay.
        (drawn,) = heard.of("picture", new)
        assert drawn.header["planned"] is False


def test_what_does_not_reach_pages_is_sent_again() -> None:
    previewer, data = Previewer(), load(PAPER, "paper")
    away = {**data, "path": {"points": [[0.35, 0.1], [0.9, 0.1]]}}
    with showing(previewer) as (screen, heard):
        late, refused, gone, again = (
            shown(previewer, x, "optimal") for x in (data, away, data, data)
        )
        heard.late += [late, gone]
        screen.show(late)
        heard.wait(lambda frames: bool(heard.of("executed", late)))
        screen.show(refused)
        heard.wait(lambda frames: bool(heard.of("refusal", refused)))
        # The motion before was not seen: the path is.
        assert [x.header["planned"] for x in heard.of("picture", refused)] == [False]
        for state in (gone, again):
            screen.show(state)
            heard.wait(lambda frames, state=state: bool(heard.of("executed", state)))  # type: ignore[misc]
        assert [len(heard.of("arm", x)) for x in (late, gone, again)] == [1, 1, 1]
