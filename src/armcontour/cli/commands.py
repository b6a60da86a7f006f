"""The commands of `armcontour`, by the modules that have them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

import typer

from armcontour.cli.program import program

# Modules of the commands, in the order of the help.
MODULES = {
    **dict.fromkeys(("run", "demo"), "run_command"),
    "studio": "studio_command",
    "show": "show_command",
    **dict.fromkeys(("batch", "place"), "study_commands"),
    **dict.fromkeys(("arms", "init"), "cell_commands"),
    "check": "check_command",
    "certify": "certify_command",
    "export": "exports",
    "identify": "identify_command",
    "learn": "learn_command",
    "play": "play_command",
    **dict.fromkeys(("compile", "schema"), "installation_commands"),
}


def program_for(arguments: Sequence[str] = ()) -> typer.Typer:
    """Program with the commands of the called module only, because loading all takes time.

    Args:
        arguments: Arguments of the program. If the first is not a command, all commands are
            loaded.
    """
    called = [MODULES[x] for x in arguments[:1] if x in MODULES]
    for name in dict.fromkeys(called or MODULES.values()):
        import_module(f"armcontour.cli.{name}")
    program.registered_commands.sort(key=lambda x: list(MODULES).index(x.name or ""))
    return program
