"""Messages and pages of the benchmarks; these tests measure no times."""

import dataclasses

import pytest
from benchmarks import baseline, page
from benchmarks.__main__ import all_lines
from benchmarks.baseline import Known
from benchmarks.measured import Bar, Line, Measured, Taken


def line(name="plan", peer="toppra", bar=None):
    return Line(name, "a plan", peer, pytest.fail, bar or Bar())


def measured(ratio, benchmark_line=None, seconds=1.0):
    ours = Taken(seconds, 2 * seconds, 1e9)
    return Measured(benchmark_line or line(), [ours], [Taken(seconds / ratio, seconds / ratio)])


KNOWN = {"plan": Known(ratio=0.5, runs=3, spread=0.02, peer="toppra")}


def test_slower_is_more_than_ten_percent_over_the_baseline():
    for ratio, slower in ((0.3, False), (0.5, False), (0.549, False), (0.551, True), (2.0, True)):
        assert baseline.is_slower(measured(ratio), KNOWN) is slower
        assert baseline.change(measured(ratio), KNOWN) == pytest.approx(ratio / 0.5 - 1)
    assert baseline.change(measured(0.9, line(peer="another")), KNOWN) is None
    baselines = {**KNOWN, "loop": dataclasses.replace(KNOWN["plan"], peer="numpy")}
    assert baseline.sentences(
        [measured(0.6), measured(0.75, line("loop", "numpy"))], baselines
    ) == [
        "Slower than the baseline by 50%: loop takes 0.75 of numpy, 0.5 before.",
        "Slower than the baseline by 20%: plan takes 0.6 of toppra, 0.5 before.",
    ]
    assert baseline.sentences([measured(0.5), measured(9.0, line("new"))], KNOWN) == [
        "No line is slower than the baseline by more than 10%.",
        "Not in the baseline yet: new.",
    ]
    missed = measured(0.5, line(bar=Bar(ratio=0.4, memory=2e9)))
    words = "Misses its bar of 0.4, 2 GB: plan has 0.5, 1 GB."
    assert baseline.sentences([missed], KNOWN)[1:] == [words]


def test_the_pages_show_the_baseline_and_every_missed_bar():
    lines, sessions = all_lines(), baseline.read(baseline.FILE)
    texts = [x.read_text(encoding="utf-8") for x in page.FILES]
    for text in texts:
        assert page.filled(text, lines, sessions) == text, "Run `python -m benchmarks --page`."
    begins = tuple(x for text in texts for x in page.named(text))
    missed = [name for name, x in baseline.baselines_by_name(sessions).items() if x.missed]
    assert [x for x in missed if not x.startswith(begins)] == []
