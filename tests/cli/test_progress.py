"""The time left of a job, from what its steps took, and its lines in a pipe."""

import pytest

from armcontour._progress import Step
from armcontour.cli.progress import (
    EVERY,
    JobProgress,
    Lines,
    job_progress,
    search_progress,
    share_progress,
)

STEPS = ("rounding", "timing", "evaluation")


class Bench:
    """A clock that is set, and what was shown last."""

    def __init__(self):
        self.now, self.what, self.spent, self.whole = 100.0, "", 0.0, 0.0
        self.progress = JobProgress(self._show, lambda: self.now)

    def _show(self, what, spent, whole):
        self.what, self.spent, self.whole = what, spent, whole

    def after(self, seconds, *names, done=None):
        """The time left [s] when a step is reported."""
        self.now += seconds
        self.progress(Step(names, done))
        return self.whole - self.spent


def test_the_time_left_is_what_the_same_steps_took_before():
    bench = Bench()
    bench.progress.expect([*STEPS, *STEPS, "writing"])
    # The first step promises nothing.
    assert bench.after(0.0, "one", "rounding") == 0.0
    # All that is known is one step of 2 s; five more are to come.
    assert bench.after(2.0, "one", "timing") == pytest.approx(2.0 * 6)
    bench.after(6.0, "one", "evaluation")
    bench.after(1.0, "two", "rounding")
    assert bench.what == "two: rounding" and bench.spent == pytest.approx(9.0)
    # 2 s + 6 s + 1 s, and for writing their mean.
    assert bench.whole - bench.spent == pytest.approx(9.0 + 3.0)
    assert bench.after(2.0, "two", "timing") == pytest.approx(6.0 + 1.0 + (2 + 6 + 1 + 2) / 4)


def test_shares_and_repetitions_of_a_step():
    bench = Bench()
    bench.after(0.0, "reading", "part.ngc")
    assert bench.after(3.0, "reading", "part.ngc", done=0.25) == pytest.approx(9.0)
    assert bench.after(3.0, "reading", "part.ngc", done=0.5) == pytest.approx(6.0)
    assert bench.after(5.0, "reading", "part.ngc", done=1.0) == 0.0
    # The same step is shown again after a moment, another one or another part of it at once.
    bench.after(0.01, "reading", "part.ngc", done=0.1)
    assert bench.spent == pytest.approx(11.0)
    bench.after(0.01, "one", "timing")
    bench.after(0.01, "one", "timing", "a\x1b[2Jb")
    assert bench.what == r"one: timing: a\x1b[2Jb" and bench.spent == pytest.approx(11.03)


def test_a_pipe_gets_a_line_of_long_work_now_and_then(capsys, monkeypatch):
    now = 0.0
    lines, quiet = (Lines(wanted, lambda: now) for wanted in (True, False))
    for now in (1.0, EVERY - 0.1, EVERY, EVERY + 1, 2 * EVERY):
        quiet.tell("one: shaping")
        lines.tell(f"one: shaping {now:g}", "40%" if now == EVERY else None)
    assert capsys.readouterr().err == f"one: shaping {EVERY:g}, 40%\none: shaping {2 * EVERY:g}\n"
    with share_progress() as progress:
        # The first step is written at once.
        progress(Step(("compiling, once", "3 functions in 2 processes"), 0.0))
        progress(Step(("compiling, once", "3 functions in 2 processes", "one"), 0.5))
    assert capsys.readouterr().err == "compiling, once: 3 functions in 2 processes\n"
    monkeypatch.setattr("armcontour.cli.progress.EVERY", 0.0)
    with job_progress() as progress, search_progress("placing") as searching:
        progress(Step(("one", "shaping"), 0.5))
        searching(Step(("2 mm", "shaping"), 0.5))
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("one: shaping") and second == "placing: 2 mm: shaping, 50%"
