"""Pages of the reference of the command line, from the commands."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer.main
from docs.site.tables import cell, contents, table

from armcontour.cli.commands import program_for

HEAD = """# Command line

`armcontour --help` lists the commands, and `armcontour COMMAND --help` the options of a command. A
*quantity* is text with a unit, such as `5 mm`. Text without a unit is refused. The brackets contain
the SI unit of the option. If an option has no default, the value of the job applies without it.

"""
# Text options whose value is a quantity with a unit, or several quantities.
QUANTITIES = {
    "--position": "quantities [m]",
    "--rpy": "quantities [rad]",
    "--noise": "quantities [rad]",
    "--speed": "quantity [m/s]",
    "--rate": "quantity [Hz]",
    "--point-tolerance": "quantity [rad]",
    **dict.fromkeys(
        ("--tolerance", "--total-tolerance", "--resume-at", "--rejoin", "--servo-error"),
        "quantity [m]",
    ),
    **dict.fromkeys(("--cycle", "--drive-cycle", "--from", "--to"), "quantity [s]"),
}
HELP = "| `-h`<br>`--help` | | | Show a help text and exit. |"


def write_commands() -> Iterator[tuple[str, str]]:
    """Yield the place and text of a page for each command, and of the page that lists them."""
    group: Any = typer.main.get_command(program_for())
    rows = []
    for name, command in group.commands.items():
        yield f"commands/{name}.md", _page(name, command)
        rows.append(f"| [{name}]({name}.md) | {cell(command.help.strip().splitlines()[0])} |")
    yield (
        "commands/index.md",
        HEAD
        + table("command", "effect", rows=rows)
        + f"\n## Options of armcontour itself\n\n{_options(group, _kinds(group))}"
        + "\n[Errors](../../errors.md) lists the exit codes, their meaning and remedies.\n"
        + contents(group.commands),
    )


def _page(name: str, command: Any) -> str:
    """Return the page of a command."""
    kinds = _kinds(command)
    arguments = [x for x in command.params if x.param_type_name == "argument"]
    operands = [_usage_name(x) if x.required else f"[{_usage_name(x)}]" for x in arguments]
    usage = " ".join(["armcontour", name, *operands, "[OPTIONS]"])
    parts = [f"# armcontour {name}", command.help.strip(), f"```text\n{usage}\n```"]
    if arguments:
        rows = [_row(f"`{_usage_name(x)}`", x, kinds) for x in arguments]
        parts.append(table("argument", "value", "default", "meaning", rows=rows).rstrip())
    example = command.epilog.splitlines()[-1].strip()
    return "\n\n".join([*parts, _options(command, kinds), f"Example:\n\n```text\n{example}\n```"])


def _kinds(command: Any) -> dict[str, Any]:
    """Map each parameter of a command to its type; bool for parameters that typer adds."""
    taken = inspect.signature(command.callback, eval_str=True).parameters
    annotations = {k: x.annotation for k, x in taken.items()}
    return {
        x.name: get_args(annotations[x.name])[0] if x.name in annotations else bool
        for x in command.params
    }


def _options(command: Any, kinds: dict[str, Any]) -> str:
    """Return the table of the options of a command."""
    rows = []
    for x in command.params:
        if x.param_type_name == "option" and not x.hidden:
            names = [f"`{name}`" for name in (*x.opts, *x.secondary_opts)]
            rows.append(_row("<br>".join(names), x, kinds))
    return table("option", "value", "default", "effect", rows=[*rows, HELP])


def _usage_name(argument: Any) -> str:
    """Return the name of an argument in the usage line."""
    return str(argument.metavar or argument.name.upper())


def _row(name: str, parameter: Any, kinds: dict[str, Any]) -> str:
    """Return the table row of an argument or option."""
    value = _value(parameter, kinds[parameter.name])
    return f"| {name} | {value} | {_default(parameter)} | {cell(parameter.help)} |"


def _value(parameter: Any, kind: Any) -> str:
    """Describe the values that an argument or option takes; empty for a flag."""
    if get_origin(kind) is Literal:
        return " or ".join(f"`{x}`" for x in get_args(kind))
    while not isinstance(kind, type):
        # Optional types contain None, and options that may be repeated are lists.
        kind = next(x for x in get_args(kind) if x is not type(None))
    if kind is bool:
        return ""
    if kind is Path:
        return "file or folder"
    if kind in (int, float):
        words = "whole number" if kind is int else "number"
        ends = (("at least", parameter.min), ("at most", parameter.max))
        return ", ".join([words, *(f"{word} {x:g}" for word, x in ends if x is not None)])
    return QUANTITIES.get(parameter.opts[0], "text")


def _default(parameter: Any) -> str:
    """Return the default of an argument or option."""
    if parameter.required:
        return "required"
    value = parameter.default
    if getattr(parameter, "is_flag", False):
        names = (parameter.secondary_opts, parameter.opts)[bool(value)]
        return f"`{names[0]}`" if parameter.secondary_opts else ""
    return "" if value is None else f"`{value}`"
