"""Every command, argument and option of the command line has a help text."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.cli.options import TOPICS

GROUP: Any = typer.main.get_command(app)
COMMANDS: dict[str, Any] = {"armcontour": GROUP, **GROUP.commands}
every = pytest.mark.parametrize("name", COMMANDS)


def is_sentence(text: str | None) -> bool:
    """Whether a text has two words at least, begins in capitals or with a code, and ends."""
    return (
        text is not None
        and text == text.strip()
        and text.endswith(".")
        and len(text.split()) > 1
        and not text[0].islower()
        and "ikewise" not in text
    )


def parameters(name: str) -> Iterator[tuple[str, Any]]:
    for x in COMMANDS[name].params:
        yield "/".join([*x.opts, *x.secondary_opts]), x


@every
def test_a_command_says_what_it_does(name: str) -> None:
    assert is_sentence(COMMANDS[name].help), COMMANDS[name].help


@every
def test_every_argument_and_option_has_a_sentence(name: str) -> None:
    missing = {label: x.help for label, x in parameters(name) if not is_sentence(x.help)}
    assert missing == {}


@every
def test_no_option_is_there_twice(name: str) -> None:
    names = Counter(
        opt for _, x in parameters(name) for opt in (*x.opts, *x.secondary_opts, x.name)
    )
    # An argument's name is its only one, and stands in both places.
    twice = {x for x, n in names.items() if n > 1 and x.startswith("-")}
    assert twice == set()
    assert all(n <= 2 for n in names.values())


@every
def test_help_is_printed(name: str) -> None:
    arguments = ["--help"] if name == "armcontour" else [name, "--help"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0
    said = " ".join(done.output.split())
    assert " ".join(COMMANDS[name].help.split()) in said
    for label, _ in parameters(name):
        assert label.split("/")[0] in said or label.upper() in said


@every
def test_options_stand_in_short_sections(name: str) -> None:
    arguments = ["--help"] if name == "armcontour" else [name, "--help"]
    sections = re.split(r"^\S.*:$", CliRunner().invoke(app, arguments).output, flags=re.MULTILINE)
    counts = [len(re.findall(r"^  (?=\S)(?:-|\w+ {2})", x, re.MULTILINE)) for x in sections[1:]]
    assert 1 <= max(counts) <= 10
    known = {x.name for command in COMMANDS.values() for x in command.params}
    assert {x for names in TOPICS.values() for x in names} <= known


@pytest.mark.parametrize("name", GROUP.commands)
def test_the_help_ends_with_an_example(name: str) -> None:
    last = CliRunner().invoke(app, [name, "--help"]).output.strip().splitlines()[-1]
    program, command, *arguments = shlex.split(last)
    assert (program, command) == ("armcontour", name)
    COMMANDS[name].make_context(name, arguments).close()
