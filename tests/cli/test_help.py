"""Every command, argument and option of the command line has a help text."""

import re
import shlex
import subprocess
import sys
from collections import Counter

import pytest
import typer
from typer.testing import CliRunner

from armcontour.cli.commands import app

GROUP = typer.main.get_command(app)
COMMANDS = {"armcontour": GROUP, **GROUP.commands}


def is_sentence(text):
    """Whether a text has two words at least, begins in capitals or with a code, and ends."""
    return (
        text is not None
        and text == text.strip()
        and text.endswith(".")
        and len(text.split()) > 1
        and not text[0].islower()
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_help_in_short_sections_that_ends_with_an_example(name):
    command = COMMANDS[name]
    assert is_sentence(command.help), command.help
    labels = {"/".join([*x.opts, *x.secondary_opts]): x for x in command.params}
    assert {label: x.help for label, x in labels.items() if not is_sentence(x.help)} == {}
    names = Counter(opt for x in command.params for opt in (*x.opts, *x.secondary_opts, x.name))
    # An argument's name is its only one, and is listed twice.
    assert {x for x, n in names.items() if n > 1 and x.startswith("-")} == set()
    assert all(n <= 2 for n in names.values())
    done = CliRunner().invoke(app, ["--help"] if name == "armcontour" else [name, "--help"])
    assert done.exit_code == 0
    said = " ".join(done.output.split())
    assert " ".join(command.help.split()) in said
    for label in labels:
        assert label.split("/")[0] in said or label.upper() in said
    sections = re.split(r"^\S.*:$", done.output, flags=re.MULTILINE)
    counts = [len(re.findall(r"^  (?=\S)(?:-|\w+ {2})", x, re.MULTILINE)) for x in sections[1:]]
    assert 1 <= max(counts) <= 10
    if name != "armcontour":
        program, example, *arguments = shlex.split(done.output.strip().splitlines()[-1])
        assert (program, example) == ("armcontour", name)
        command.make_context(name, arguments).close()


@pytest.mark.parametrize("line", [["--help"], ["check", "--help"]])
def test_help_imports_nothing_heavy(line):
    code = (
        "import sys\n"
        f"sys.argv = ['armcontour', *{line!r}]\n"
        "from armcontour.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'plotly', 'pint', 'yaml', 'jinja2'}\n"
        "sys.exit(len(heavy & set(sys.modules)))\n"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0
