"""Text of files on a terminal: no control sequence gets through."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour.cli
from armcontour._text import to_line
from armcontour.cli.console import Console

CLIPBOARD = "x\x1b]52;c;cHduZWQ=\x1b\\y"


@given(st.text())
def test_whatever_is_said_is_printable(text: str) -> None:
    assert to_line(text).isprintable()
    if text.isprintable() and len(text) < 1000:
        assert to_line(text) == text


def test_a_sentence_is_bounded() -> None:
    assert len(to_line("x" * 100_000)) < 5000


def test_tables_and_lines_escape_what_a_terminal_would_obey(
    capsys: pytest.CaptureFixture[str],
) -> None:
    console = Console()
    console.show_table(["a"], [[CLIPBOARD], ["[bold]plain[/bold]"]], title=CLIPBOARD)
    console.say(CLIPBOARD)
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and shown.count(r"\x1b]52") == 3
    assert "[bold]plain[/bold]" in shown


def test_errors_escape_names_of_files(tmp_path: FilePath, command_in: Callable[..., Any]) -> None:
    done = command_in(tmp_path, "run", f"{CLIPBOARD}.yaml", "--out", "out")
    assert done.code == 2
    assert "\x1b" not in done.errors and r"\x1b]52" in done.errors


def test_output_that_cannot_be_written_is_one_sentence(tmp_path: FilePath) -> None:
    full = FilePath("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    with full.open("w") as stream:
        done = subprocess.run(
            [sys.executable, "-m", "armcontour", "schema"],
            stdout=stream,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1


def test_commands_print_only_through_the_console() -> None:
    """`print` may write what this program made itself: JSON, which escapes control characters."""
    for file in FilePath(armcontour.cli.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                if node.func.id != "print" or file.name == "entry.py":
                    continue
                shown = ast.unparse(node.args[0])
                assert "json" in shown, f"{file.name}: print({shown})"


def test_names_are_folded_and_not_cut(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("armcontour.cli.console.WIDTH", 40)
    Console().show_table(["run", *("motion [s]",) * 3], [("compensated-by-poles", "1", "2", "3")])
    shown = capsys.readouterr().out
    assert "…" not in shown
    cells = [line.split("│")[1].strip() for line in shown.splitlines() if "│" in line]
    assert "".join(cells) == "compensated-by-poles"
