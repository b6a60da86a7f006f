"""The command `warm`."""

from pathlib import Path as FilePath

import pytest

import armcontour
from armcontour import _warming
from armcontour._progress import Step

KEPT = FilePath(armcontour.__file__).parent / "__pycache__"


@pytest.fixture
def asked(monkeypatch):
    """What the command asks for, where nothing is compiled."""
    asked: list[str] = []

    def warm(which, progress):
        asked.append(which)
        progress(Step(("compiling, once", "5 functions in 2 processes"), 0.0))
        return _warming.Warmed(5, 2, KEPT)

    monkeypatch.setattr(_warming, "warm", warm)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    return asked


def test_warm_reports_the_compiled_functions_and_their_folder(
    command, asked, tmp_path, monkeypatch
):
    ended = command("warm")
    assert ended.code == 0 and asked == ["all"]
    assert f"5 functions are compiled, 2 of them now. They are kept in {KEPT}." in ended.out
    assert ended.errors == "compiling, once: 5 functions in 2 processes\n"
    assert command("warm", "plane").code == 0 and asked == ["all", "plane"]
    assert command("warm", "moon").code == 2
    # The package's own folder cannot be written.
    found = _warming.Warmed(5, 2, tmp_path)
    monkeypatch.setattr(_warming, "warm", lambda which, progress: found)
    assert "NUMBA_CACHE_DIR" in command("warm").out
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert command("warm").out.count("\n") == 1
