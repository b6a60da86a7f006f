"""The time left of a job, from what its steps took."""

from __future__ import annotations

import re
import time

import pytest

from armcontour._progress import Step, tell_compiling, under
from armcontour.cli.progress import (
    EVERY,
    JobProgress,
    Lines,
    compiling_said,
    job_progress,
    search_progress,
    share_progress,
)

STEPS = ("rounding", "timing", "evaluation")


class Bench:
    """A clock that is set, and what was shown last."""

    def __init__(self) -> None:
        self.now, self.what, self.spent, self.whole = 100.0, "", 0.0, 0.0
        self.progress = JobProgress(self._show, lambda: self.now)

    def _show(self, what: str, spent: float, whole: float) -> None:
        self.what, self.spent, self.whole = what, spent, whole

    def after(self, seconds: float, *names: str, done: float | None = None) -> float:
        """The time left [s] when a step is told."""
        self.now += seconds
        self.progress(Step(names, done))
        return self.whole - self.spent


def test_the_time_left_is_what_the_same_steps_took_before() -> None:
    bench = Bench()
    bench.progress.expect([*STEPS, *STEPS, "writing"])
    bench.after(0.0, "one", "rounding")
    # All that is known is one step of 2 s; five more are to come.
    assert bench.after(2.0, "one", "timing") == pytest.approx(2.0 * 6)
    bench.after(6.0, "one", "evaluation")
    bench.after(1.0, "two", "rounding")
    assert bench.what == "two: rounding" and bench.spent == pytest.approx(9.0)
    # 2 s + 6 s + 1 s, and for writing their mean.
    assert bench.whole - bench.spent == pytest.approx(9.0 + 3.0)
    assert bench.after(2.0, "two", "timing") == pytest.approx(6.0 + 1.0 + (2 + 6 + 1 + 2) / 4)


def test_a_step_is_shown_again_after_a_moment() -> None:
    bench = Bench()
    bench.after(0.0, "one", "tracing")
    bench.after(0.01, "one", "tracing", done=0.1)
    assert bench.spent == 0.0
    bench.after(0.05, "one", "tracing", done=0.2)
    assert bench.spent == pytest.approx(0.06)
    # Another step is shown at once, and so is another part of the same step.
    bench.after(0.01, "one", "timing")
    assert bench.what == "one: timing"
    bench.after(0.01, "one", "timing", "more")
    assert bench.what == "one: timing: more"


def test_a_share_says_how_long_its_step_takes() -> None:
    bench = Bench()
    bench.after(0.0, "reading", "part.ngc")
    assert bench.after(3.0, "reading", "part.ngc", done=0.25) == pytest.approx(9.0)
    assert bench.after(3.0, "reading", "part.ngc", done=0.5) == pytest.approx(6.0)
    assert bench.after(5.0, "reading", "part.ngc", done=1.0) == 0.0
    assert bench.what == "reading: part.ngc"


def test_the_first_step_promises_nothing_and_names_are_one_line() -> None:
    bench = Bench()
    assert bench.after(0.0, "a\x1b[2Jb", "timing") == 0.0
    assert bench.what == r"a\x1b[2Jb: timing"


def test_steps_are_passed_on_under_names() -> None:
    heard: list[Step] = []
    tell = under(under(heard.append, "outer"), "inner")
    tell(Step(("timing",), 0.5))
    assert heard == [Step(("outer", "inner", "timing"), 0.5)]
    assert str(heard[0]) == "outer: inner: timing"
    under(None, "outer")(Step(("timing",)))


def test_a_terminal_shows_the_step_and_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    with job_progress() as progress:
        progress(Step(("reading", "part.ngc")))
    assert "reading: part.ngc" in (shown := capsys.readouterr().err) and "-:--:--" in shown
    with job_progress() as progress:
        progress.expect(["timing", "evaluation"] * 500)
        progress(Step(("one", "timing")))
        time.sleep(0.02)
        progress(Step(("one", "evaluation")))
    # 999 steps of 0.02 s, or of more where the machine is busy.
    seconds = re.findall(r"left 0:(\d\d):(\d\d)", capsys.readouterr().err)[-1]
    assert int(seconds[0]) * 60 + int(seconds[1]) >= 19
    with search_progress("certifying") as progress:
        progress(Step(("1 ms", "trial 3")))
    assert "certifying: 1 ms: trial 3" in capsys.readouterr().err


def test_a_pipe_gets_a_line_of_long_work_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    lines, quiet = (Lines(wanted, lambda: now) for wanted in (True, False))
    for now in (1.0, EVERY - 0.1, EVERY, EVERY + 1, 2 * EVERY):
        quiet.tell("one: shaping")
        lines.tell(f"one: shaping {now:g}", "40%" if now == EVERY else None)
    assert capsys.readouterr().err == f"one: shaping {EVERY:g}, 40%\none: shaping {2 * EVERY:g}\n"


def test_progress_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with job_progress() as progress, search_progress("sweeping") as searching:
        progress(Step(("one", "shaping"), 0.1))
        searching(Step(("2 mm", "shaping"), 0.1))
        assert capsys.readouterr().err == ""
        monkeypatch.setattr("armcontour.cli.progress.EVERY", 0.0)
        monkeypatch.setattr("armcontour.cli.progress.MOMENT", 0.0)
        progress(Step(("one", "shaping"), 0.5))
        searching(Step(("2 mm", "shaping"), 0.5))
    first, second = capsys.readouterr().err.splitlines()
    assert re.fullmatch(r"one: shaping(, \d+%, left 0:00:0\d)?", first)
    assert second == "sweeping: 2 mm: shaping, 50%"


def test_compiling_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    with compiling_said():
        tell_compiling("armcontour.arms._newton.solve")
        tell_compiling("armcontour.arms._newton.follow")
    tell_compiling("armcontour.arms._newton.newton")
    said = capsys.readouterr().err
    words = (
        "once: no command before has needed them all; `armcontour warm` compiles everything "
        "beforehand."
    )
    assert said == f"Compiling functions, {words}\n"
    with compiling_said():
        tell_compiling("63 functions in 2 processes")
    said = capsys.readouterr().err
    assert said == f"Compiling up to 63 functions in 2 processes, {words}\n"


def test_a_bar_names_what_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(Lines, "tell", lambda self, words, more=None: told.append(words))
    with search_progress("certifying"), job_progress():
        tell_compiling("armcontour.arms._newton.solve")
    tell_compiling("armcontour.arms._newton.follow")
    named = "compiling, once: armcontour.arms._newton.solve"
    assert told == [f"certifying: {named}", named]


def test_a_share_is_shown_at_once_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    with share_progress() as progress:
        progress(Step(("compiling, once", "3 functions in 2 processes"), 0.0))
        progress(Step(("compiling, once", "3 functions in 2 processes", "one"), 0.5))
    said = capsys.readouterr().err
    assert said == "compiling, once: 3 functions in 2 processes\n"
