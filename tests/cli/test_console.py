"""Terminal output escapes control sequences in texts of files."""

import ast
from pathlib import Path as FilePath

from hypothesis import given
from hypothesis import strategies as st

import armcontour.cli
from armcontour.cli import console
from armcontour.cli.console import ProgressDisplay, print_lines, table_lines
from armcontour.core.progress import Step, TimeLeft
from armcontour.core.text import to_line

CLIPBOARD = "x\x1b]52;c;cHduZWQ=\x1b\\y"


@given(st.text())
def test_every_printed_line_has_printable_characters(text):
    assert to_line(text).isprintable()
    if text.isprintable() and len(text) < 1000:
        assert to_line(text) == text
    assert len(to_line("x" * 100_000)) < 5000


def test_printed_tables_and_lines_and_errors_escape_control_sequences(capsys, tmp_path, command_in):
    print_lines(*table_lines([["a"], [CLIPBOARD], ["[bold]plain[/bold]"]], CLIPBOARD), CLIPBOARD)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and shown.count(r"\x1b]52") == 3
    assert "[bold]plain[/bold]" in shown
    outcome = command_in(tmp_path, "run", f"{CLIPBOARD}.yaml", "--out", "out")
    assert outcome.code == 2
    assert "\x1b" not in outcome.errors and r"\x1b]52" in outcome.errors


def test_commands_print_only_through_the_console():
    """`print` may write what this program made itself: JSON, which escapes control characters."""
    for file in FilePath(armcontour.cli.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                if node.func.id != "print" or file.name == "entry.py":
                    continue
                shown = ast.unparse(node.args[0])
                assert "json" in shown, f"{file.name}: print({shown})"


class Clock:
    """A clock that a test sets [s]."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def test_time_left_is_estimated_from_the_parts_of_the_same_step():
    clock = Clock()
    time_left = TimeLeft(clock)
    assert time_left.after(Step(("tracing",))) is None
    clock.now = 10.0
    # 10 s for a quarter: three quarters take 30 s more.
    assert time_left.after(Step(("tracing",), 0.25)) == 30.0
    clock.now = 20.0
    assert time_left.after(Step(("tracing",), 0.5)) == 20.0
    assert time_left.after(Step(("tracing",), 1.0)) is None
    # The time of the step before does not count.
    clock.now = 100.0
    assert time_left.after(Step(("timing",), 0.2)) is None
    clock.now = 101.0
    assert abs(time_left.after(Step(("timing",), 0.3)) - 7.0) < 1e-9


def test_progress_says_which_contour_of_how_many_and_the_time_left(capsys, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(console.time, "monotonic", clock)
    display = ProgressDisplay("run")
    display(Step(("fast", "tracing")))
    clock.now = 30.0
    display(Step(("fast", "tracing"), 0.25, "contour 10 of 40"))
    clock.now = 630.0
    display(Step(("fast", "tracing"), 0.5, "contour 20 of 40"))
    first, second = capsys.readouterr().err.splitlines()
    for expected in ("contour 10 of 40", "25%", "90 s left"):
        assert expected in first
    for expected in ("contour 20 of 40", "50%", "10 min left"):
        assert expected in second


def test_numbers_of_a_wide_table_are_not_divided_between_lines():
    numbers = [f"0.{k}01234 mm" for k in range(10)]
    heading = [f"{'a long name of a column ' * 2}{k}" for k in range(10)]
    lines = table_lines([["job", *heading], ["1", *numbers], ["2", *numbers]])
    assert {x.split(" ")[0] for x in numbers} <= set(" ".join(lines[-6:]).split())
    assert len({len(x) for x in lines}) == 1
