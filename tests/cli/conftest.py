"""The command line in this process: a process of its own would take a second to start."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import NamedTuple

import pytest

from armcontour.cli import main


class Ended(NamedTuple):
    """How a command ended: its exit code, what it printed, and its errors."""

    code: int
    out: str
    errors: str


Command = Callable[..., Ended]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run the command line in this process: its exit code, what it printed, and its errors."""

    def call(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["armcontour", *map(str, arguments)])
        monkeypatch.setattr(sys, "path", sys.path[:])
        monkeypatch.setattr(signal, "signal", lambda *_: None)
        with pytest.raises(SystemExit) as ended:
            main()
        shown = capsys.readouterr()
        code = ended.value.code or 0
        assert isinstance(code, int)
        return Ended(code, shown.out, shown.err)

    return call


@pytest.fixture
def command_in(command: Command, monkeypatch: pytest.MonkeyPatch) -> Command:
    """The same in a folder: `command_in(folder, "run", "job.yaml")`."""

    def call(folder: FilePath, *arguments: object) -> Ended:
        with monkeypatch.context() as there:
            there.chdir(folder)
            return command(*arguments)

    return call
