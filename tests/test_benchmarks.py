"""What benchmarks say of times; no test here takes any."""

from __future__ import annotations

import dataclasses
import math
import sys

import pytest
from benchmarks import baseline, page
from benchmarks.__main__ import all_lines, chosen, main, measure_all
from benchmarks.baseline import Known, Session
from benchmarks.measured import Bar, Line, Measured, Missing, Pair, Taken, measure, spawned

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no rusage of processes.")


def line(name: str = "plan", peer: str = "toppra", bar: Bar | None = None) -> Line:
    return Line(name, "a plan", peer, pytest.fail, bar or Bar())


def found(ratio: float, of: Line | None = None, seconds: float = 1.0) -> Measured:
    ours = Taken(seconds, 2 * seconds, 1e9)
    return Measured(of or line(), [ours], [Taken(seconds / ratio, seconds / ratio)])


KNOWN = {"plan": Known(ratio=0.5, runs=3, spread=0.02, peer="toppra")}
FULL = Known(0.031, 3, 0.1, "toppra", 0.56e-3, 18e-3, "0.031", False, ("10.3 s; none < 1e-9", "|"))


@pytest.mark.parametrize(
    ("ratio", "slower"), [(0.3, False), (0.5, False), (0.549, False), (0.551, True), (2.0, True)]
)
def test_slower_is_more_than_ten_percent_over_the_baseline(ratio, slower):
    assert baseline.is_slower(found(ratio), KNOWN) is slower
    assert math.isclose(baseline.change(found(ratio), KNOWN), ratio / 0.5 - 1)


def test_what_is_slower_is_said_with_both_ratios_the_worst_first():
    known = {**KNOWN, "loop": dataclasses.replace(KNOWN["plan"], peer="numpy")}
    said = baseline.sentences([found(0.6), found(0.75, line("loop", "numpy"))], known)
    assert said == [
        "Slower than the baseline by 50%: loop takes 0.75 of numpy, 0.5 before.",
        "Slower than the baseline by 20%: plan takes 0.6 of toppra, 0.5 before.",
    ]


def test_new_lines_are_named_and_are_no_failures():
    new = found(9.0, line("new"))
    assert not baseline.is_slower(new, KNOWN)
    assert baseline.sentences([found(0.5), new], KNOWN) == [
        "No line is slower than the baseline by more than 10%.",
        "Not in the baseline yet: new.",
    ]


def test_missed_bars_are_said():
    missed = found(0.5, line(bar=Bar(ratio=0.4, memory=2e9)))
    assert baseline.sentences([missed], KNOWN)[1:] == [
        "Misses its bar of 0.4, 2 GB: plan has 0.5, 1 GB."
    ]


def test_a_ratio_to_another_peer_is_another_line():
    assert baseline.change(found(0.9, line(peer="another")), KNOWN) is None


def test_a_line_of_the_baseline_is_the_median_of_its_measurements():
    known = Known.of([found(x) for x in (0.52, 0.5, 0.6)])
    assert known == Known(0.52, 3, 0.2, "toppra", ours=1.0, theirs=1.923)


def test_a_line_of_the_baseline_has_its_times_its_bar_and_what_was_computed():
    of = line(bar=Bar(ratio=0.4, seconds=2.0))
    known = Known.of([dataclasses.replace(found(0.5, of), notes=("0.7 s", "no violation"))])
    assert (known.ours, known.theirs) == (1.0, 2.0)
    assert known.of_bar == "0.5, 1 s" and known.missed
    assert known.notes == ("0.7 s", "no violation")


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    file = tmp_path / "baseline.json"
    assert baseline.read(file) == []
    sessions = [
        Session("2026-01-31", "abc", "a machine, 2 cores", KNOWN),
        Session("2026-02-01", "def", "a “machine”", {"loop": KNOWN["plan"], "a": FULL}),
    ]
    baseline.write(file, sessions)
    assert baseline.read(file) == sessions
    assert baseline.known(sessions).keys() == {"plan", "loop", "a"}


def test_lines_measured_anew_leave_their_old_session():
    old = Session("2026-01-31", "abc", "x", {**KNOWN, "loop": KNOWN["plan"]})
    new = Session("2026-02-01", "def", "x", {"plan": dataclasses.replace(KNOWN["plan"], ratio=0.4)})
    kept, latest = baseline.updated([old], new)
    assert kept.lines.keys() == {"loop"} and kept.commit == "abc" and latest == new
    # A session without lines is gone.
    assert baseline.updated([kept], Session("2026-02-02", "ghi", "x", old.lines))[0].commit == "ghi"


def test_lines_of_one_day_commit_and_machine_are_one_session():
    old = Session("2026-02-01", "abc", "x", {**KNOWN, "loop": KNOWN["plan"]})
    new = dataclasses.replace(old, lines={"plan": FULL})
    (joined,) = baseline.updated([old], new)
    assert joined.lines == {"plan": FULL, "loop": KNOWN["plan"]}


def test_what_was_measured_of_a_commit_on_a_machine_is_known():
    sessions = [
        Session("2026-01-31", "abc", "x", {"plan": FULL}),
        Session("2026-02-01", "abc", "x", {"loop": FULL}),
        Session("2026-02-01", "abc", "another", {"last": FULL}),
    ]
    assert baseline.done(sessions, Session("2026-02-02", "abc", "x", {})) == {"plan", "loop"}
    assert baseline.done(sessions, Session("2026-02-02", "def", "x", {})) == set()


PAGE = """\
Before.

<!-- sessions: all -->
old
<!-- end -->

<!-- lines: plan -->
<!-- end -->

Ours takes <!-- ours: plan -->1 s<!-- end -->, <!-- ratio: plan -->9 %<!-- end --> of
<!-- theirs: plan -->11 s<!-- end -->; <!-- ratio: new -->1 %<!-- end -->.
"""
FILLED = """\
Before.

<!-- sessions: all -->

| measured | commit | machine and versions | lines |
|---|---|---|---|
| 2026-01-31 | abc | a machine, 2 cores | all 2 |

<!-- end -->

<!-- lines: plan -->

| line | what | ours | against | its time | ratio | bar |
| --- | --- | --: | --- | --: | --: | --- |
| `plan` | a plan | 560 µs | toppra | 18 ms | 0.031 | 0.02 (0.031) |
| `plan/old` | a plan | - | toppra | - | 0.5 | - |
| `plan/full` | a plan | not measured yet (only if asked for) | IPOPT | - | - | - |

What was computed:

- `plan`: 10.3 s; none &lt; 1e-9; \\|

<!-- end -->

Ours takes <!-- ours: plan -->560 µs<!-- end -->, <!-- ratio: plan -->3.1 %<!-- end --> of
<!-- theirs: plan -->18 ms<!-- end -->; <!-- ratio: new -->not measured yet<!-- end -->.
"""
ON_THE_PAGE = [
    line(bar=Bar(ratio=0.02)),
    line("plan/old"),
    dataclasses.replace(line("plan/full", "IPOPT"), full=True),
    line("new"),
]


def test_a_page_is_written_from_the_baseline_between_its_marks():
    known = {"plan": FULL, "plan/old": KNOWN["plan"]}
    sessions = [Session("2026-01-31", "abc", "a machine, 2 cores", known)]
    assert page.filled(PAGE, ON_THE_PAGE, sessions) == FILLED
    assert page.filled(FILLED, ON_THE_PAGE, sessions) == FILLED


def test_a_page_says_which_lines_were_measured_when():
    sessions = [
        Session("2026-01-31", "abc", "x", {"plan/b": FULL, "plan/a": FULL, "loop": FULL}),
        Session("2026-02-01", "def", "x", {"new/a": FULL}),
        Session("2026-02-01", "def", "y", {"new/b": FULL}),
    ]
    rows = page.filled(PAGE, ON_THE_PAGE, sessions).splitlines()
    assert "| 2026-01-31 | abc | x | `loop`, `plan` |" in rows
    assert "| 2026-02-01 | def | x | `new/a` |" in rows
    assert "| 2026-02-01 | def | y | `new/b` |" in rows


@pytest.mark.parametrize("mark", ["<!-- lines: plam -->", "<!-- ratio: plam -->"])
def test_a_mark_of_no_line_is_refused(mark):
    with pytest.raises(KeyError, match="plam"):
        page.filled(f"{mark}<!-- end -->", ON_THE_PAGE, [])


def test_the_pages_show_the_baseline_and_every_line_once():
    lines, sessions = all_lines(), baseline.read(baseline.FILE)
    texts = [x.read_text(encoding="utf-8") for x in page.FILES]
    for text in texts:
        assert page.filled(text, lines, sessions) == text, "Run `python -m benchmarks --page`."
    begins = [x for text in texts for x in page.named(text)]
    assert [sum(x.name.startswith(y) for y in begins) for x in lines] == [1] * len(lines)


def steady(*seconds: float):
    """A timer whose calls take these times in turn, and the last one from then on."""
    left = list(seconds)

    def run(times: int) -> list[Taken]:
        taken = [left.pop(0) if len(left) > 1 else left[0] for _ in range(times)]
        return [Taken(x, x) for x in taken]

    return run


def line_of(pair: Pair) -> Line:
    return Line("plan", "a plan", "toppra", lambda: pair)


@pytest.mark.parametrize(
    ("bar", "missed"),
    [
        (Bar(), False),
        (Bar(ratio=0.6), False),
        (Bar(ratio=0.4), True),
        (Bar(seconds=1.5), False),
        # By the clock it took 2 s.
        (Bar(seconds=1.5, clock=True), True),
        (Bar(seconds=1.5, memory=0.9e9), True),
        (Bar(ratio=0.6, seconds=0.9), True),
    ],
)
def test_bars(bar, missed):
    assert bar.missed(0.5, Taken(processor=1.0, wall=2.0, memory=1e9)) is missed


def test_bars_in_words():
    assert str(Bar()) == "-"
    assert str(Bar(ratio=1 / 3)) == "0.333"
    assert str(Bar(seconds=12e-3)) == "12 ms"
    assert str(Bar(seconds=60, memory=2e9, clock=True)) == "60 s by the clock, 2 GB"


def test_the_ratio_is_that_of_the_least_times_and_the_bar_is_of_the_medians(monkeypatch):
    monkeypatch.setattr("benchmarks.measured.BUDGET", 2.0)
    # A call each to warm up, one to see how long it takes, and then 4 rounds of 0.5 s.
    ours = steady(0.01, 0.3, 0.2, 0.9, 0.4, 0.5)
    peer = steady(0.01, 0.2, 0.1, 0.1, 0.1, 0.7)
    of = dataclasses.replace(line_of(Pair(ours, peer)), bar=Bar(ratio=3, seconds=0.41))
    (got,) = measure(of)
    assert got.least == (0.2, 0.1) and got.ratio == 2.0
    assert got.usual.processor == 0.4 and got.usual_ratio == 4.0
    assert got.missed and got.of_bar == "4, 400 ms"


def test_long_work_is_measured_once():
    pair = Pair(steady(7.0, 9.0), steady(3.5, 9.0), warm=True, parts=(70, 1))
    (got,) = measure(line_of(pair))
    assert got.least == (0.1, 3.5)


@POSIX
def test_a_process_is_measured_with_its_own_memory():
    code = "x = bytearray(50_000_000); x[::4096] = b'1' * len(x[::4096])"
    (taken,) = spawned(lambda: [sys.executable, "-c", code])(1)
    assert 0 < taken.processor and 50e6 < taken.memory < 90e6


@POSIX
def test_a_process_that_fails_is_an_error():
    with pytest.raises(RuntimeError, match="no such file"):
        spawned(lambda: [sys.executable, "-c", "raise SystemExit('no such file')"])(1)


LINES = [
    Line(name, "", "", pytest.fail, full=name.endswith("full"))
    for name in ("plan/200", "plan/1000", "gcode/ur5e", "gcode/ur5e/full", "loop")
]


@pytest.mark.parametrize(
    ("only", "full", "names"),
    [
        (None, False, ["plan/200", "plan/1000", "gcode/ur5e", "loop"]),
        (None, True, ["plan/200", "plan/1000", "gcode/ur5e", "gcode/ur5e/full", "loop"]),
        (["plan"], False, ["plan/200", "plan/1000"]),
        (["gcode", "loop"], False, ["gcode/ur5e", "loop"]),
        (["gcode"], True, ["gcode/ur5e", "gcode/ur5e/full"]),
        (["gcode/ur5e/full"], False, ["gcode/ur5e/full"]),
    ],
)
def test_lines_are_chosen_by_the_beginning_of_their_names(only, full, names):
    assert [x.name for x in chosen(LINES, only, full)] == names


def test_a_name_that_no_line_has_is_refused():
    with pytest.raises(SystemExit, match="No line begins with plam: see --list."):
        chosen(LINES, ["plam"], False)


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Runs the program on lines whose ratios, one a measurement, are given by name."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")

    def run(ratios: dict[str, list[float]], *arguments: str) -> tuple[int, str]:
        def line_of(name: str, left: list[float]) -> Line:
            def prepare() -> Pair:
                if name == "killed":
                    raise SystemExit
                if not left:
                    raise Missing("no peer is installed")
                # Long work, of which one measurement is one round.
                return Pair(lambda _: [Taken(left.pop(0), 1.0)], steady(1.0), warm=True)

            return Line(name, "a plan", "toppra", prepare)

        lines = [line_of(name, [9 * x for x in left]) for name, left in ratios.items()]
        monkeypatch.setattr("benchmarks.__main__.all_lines", lambda: lines)
        code = main([*arguments, "--baseline", str(tmp_path / "baseline.json")])
        return code, capsys.readouterr().out

    return run


def test_the_baseline_has_medians_of_three(run, tmp_path):
    code, _ = run({"plan": [0.5, 0.7, 0.4], "loop": []}, "--update")
    (session,) = baseline.read(tmp_path / "baseline.json")
    assert code == 0 and list(session.lines) == ["plan"]
    plan = session.lines["plan"]
    assert (plan.ratio, plan.runs, plan.spread, plan.ours) == (4.5, 3, 0.75, 4.5)
    assert "Python" in session.machine


def test_a_baseline_has_every_line_as_soon_as_it_is_measured(run, tmp_path):
    with pytest.raises(SystemExit):
        run({"plan": [0.5] * 3, "killed": [], "loop": [0.5] * 3}, "--update")
    (session,) = baseline.read(tmp_path / "baseline.json")
    assert list(session.lines) == ["plan"]
    _, said = run({"plan": [0.5] * 3, "loop": [0.6] * 3}, "--continue")
    (session,) = baseline.read(tmp_path / "baseline.json")
    assert sorted(session.lines) == ["loop", "plan"] and "1/1 loop" in said


def test_what_is_slower_once_is_measured_again(run):
    run({"plan": [0.5] * 3}, "--update")
    code, said = run({"plan": [0.6, 0.7, 0.52]})
    assert code == 0 and "No line is slower" in said and said.count("once more") == 2


def test_what_is_always_slower_is_said_and_fails(run):
    run({"plan": [0.5] * 3}, "--update")
    code, said = run({"plan": [0.8, 0.6, 0.7]})
    assert code == 1
    assert "Slower than the baseline by 20%: plan takes 5.4 of toppra, 4.5 before." in said


def test_a_peer_that_is_not_installed_is_no_failure(run):
    code, said = run({"plan": [0.5], "loop": []})
    assert code == 0 and "Left out: loop, as no peer is installed." in said


def test_a_line_that_fails_is_said_when_all_are_measured(run):
    # It has no ratio for the third of its measurements.
    code, said = run({"plan": [0.5, 0.5], "loop": [0.5] * 3}, "--update")
    assert code == 1 and "Failed: plan: IndexError: pop from empty list" in said
    assert "2/2 loop: 4.5 s, 4.5 of toppra" in said


def test_what_was_measured_before_an_interruption_counts():
    def interrupt() -> Pair:
        raise KeyboardInterrupt

    steady_line = line_of(Pair(steady(9.0), steady(4.5), warm=True))
    lines = [steady_line, Line("loop", "", "", interrupt), line("last")]
    found, trouble = measure_all(lines, {}, 1)
    assert list(found) == ["plan"] and trouble == ["Interrupted: 2 lines are not measured."]
