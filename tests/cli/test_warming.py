"""The command `warm`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import pytest

import armcontour
from armcontour import _warming
from armcontour._progress import Step

Command = Callable[..., Any]
PACKAGE = FilePath(armcontour.__file__).parent


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the command asks for, where nothing is compiled."""
    asked: list[str] = []

    def warm(which: str, progress: _warming.Progress) -> _warming.Warmed:
        asked.append(which)
        progress(Step(("compiling, once", "5 functions in 2 processes"), 0.0))
        return _warming.Warmed(5, 2, PACKAGE / "__pycache__")

    monkeypatch.setattr(_warming, "warm", warm)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return asked


def test_it_says_what_is_compiled_and_where_it_is_kept(command: Command, asked: list[str]) -> None:
    ended = command("warm")
    assert ended.code == 0 and asked == ["all"]
    kept = PACKAGE / "__pycache__"
    assert ended.out == f"5 functions are compiled, 2 of them now. They are kept in {kept}.\n"
    assert ended.errors == "compiling, once: 5 functions in 2 processes\n"
    assert command("warm", "plane").code == 0 and asked == ["all", "plane"]
    assert command("warm", "moon").code == 2


def test_a_folder_of_ones_own_is_said(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    found = _warming.Warmed(5, 2, tmp_path)
    monkeypatch.setattr(_warming, "warm", lambda which, progress: found)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    out = command("warm").out
    assert f"because the folder {PACKAGE} cannot be written" in out and "NUMBA_CACHE_DIR" in out
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert command("warm").out.count("\n") == 1
