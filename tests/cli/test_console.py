"""Terminal output escapes control sequences in texts of files."""

import ast
from pathlib import Path as FilePath

from hypothesis import given
from hypothesis import strategies as st

import armcontour.cli
from armcontour.cli.console import print_lines, table_lines
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
