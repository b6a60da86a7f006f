"""The command line in this process; a separate process would take a second to start."""

import signal
import sys
from typing import NamedTuple

import pytest

from armcontour.cli import main


class Ended(NamedTuple):
    """Result of a command: its exit code, its output and its errors."""

    code: int
    out: str
    errors: str


@pytest.fixture
def command(monkeypatch, capsys):
    """Run the command line in this process."""

    def call(*arguments):
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
def done(command):
    """Run a command that has to succeed; returns its output."""

    def call(*arguments):
        ended = command(*arguments)
        assert ended.code == 0, ended
        return ended.out

    return call


@pytest.fixture
def command_in(command, monkeypatch):
    """The same in a folder: `command_in(folder, "run", "job.yaml")`."""

    def call(folder, *arguments):
        with monkeypatch.context() as there:
            there.chdir(folder)
            return command(*arguments)

    return call


@pytest.fixture
def refused(command_in):
    """Find rows `(arguments, words)` that are not refused with this exit code in one sentence."""

    def faults(folder, rows, codes=(2, 3), begin=()):
        unclear = []
        before = sorted(folder.rglob("*"))
        for arguments, words in rows:
            arguments = arguments.split() if isinstance(arguments, str) else arguments
            ended = command_in(folder, *begin, *arguments)
            missing = [x for x in words if x not in " ".join(ended.errors.split())]
            sentence = ended.errors.count("\n") == 1 and ended.errors.startswith("Error: ")
            if ended.code not in codes or missing or not sentence:
                unclear.append((arguments, ended, missing))
            if sorted(folder.rglob("*")) != before:
                unclear.append((arguments, "it wrote a file"))
        return unclear

    return faults
