"""Write pages of the reference from the code: names, commands, errors; and pages of the project."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import armcontour as ac
from armcontour import errors

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
# Texts of the repository that the site has too, and where its folder of pages has them.
PROJECT = {
    "README.md": "readme",
    "CHANGELOG.md": "changelog",
    "CONTRIBUTING.md": "contributing",
    "SECURITY.md": "security",
}


def write(folder: Path) -> None:
    """Write all pages that are made.

    Args:
        folder: Folder for them; what it held before is removed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    pages = dict(page for make in (names, commands, error_classes, project) for page in make())
    for name, text in pages.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, encoding="utf-8")


def names() -> Iterator[tuple[str, str]]:
    """A page for each room with its public names, and one that lists them all."""
    listed, known = [], set[int]()
    for room in rooms():
        module = importlib.import_module(f"armcontour.{room}")
        # What two rooms have has its page in the first one.
        own = [(name, x) for name, x in public_of(room, module) if id(x) not in known]
        known.update(id(x) for _, x in own)
        title = f"armcontour.{room}"
        lines = [title, "=" * len(title), "", _first_line(module), ""]
        for name, value in own:
            kind = "autoclass" if inspect.isclass(value) else "autofunction"
            lines += [f".. {kind}:: {name}", *_options(value), ""]
        yield f"api/{room}.rst", "\n".join(lines)
        at_top = [x.removeprefix("armcontour.") for x, _ in own if x.count(".") == 1]
        linked = ", ".join(f"[`{x}`](#armcontour.{x})" for x in at_top)
        listed.append(f"| [{room}]({room}.rst) | {_first_line(module)} | {linked} |")
    toc = "\n".join(f"{x}" for x in rooms())
    yield (
        "api/index.md",
        "# Python\n\nNames of `armcontour` itself stay; those of its rooms may move between "
        "versions.\n\n| room | what it holds | in `armcontour` itself |\n|---|---|---|\n"
        + "\n".join(listed)
        + f"\n\n```{{toctree}}\n:hidden:\n\n{toc}\n```\n",
    )


def rooms() -> list[str]:
    """Names of the public rooms and modules."""
    found = [x.name for x in pkgutil.iter_modules(ac.__path__) if not x.name.startswith("_")]
    return [x for x in found if x not in ("cli", "studio")]


def public_of(room: str, module: Any) -> list[tuple[str, Any]]:
    """Public names of a room with what they name; those of the package itself under its name.

    Args:
        room: Name of the room.
        module: The room.
    """
    own = getattr(module, "__all__", None) or [
        name
        for name, x in vars(module).items()
        if not name.startswith("_") and getattr(x, "__module__", "") == module.__name__
    ]
    found = {name: getattr(module, name) for name in own}
    # Some names of the package are of a module inside a room.
    for name in ac.__all__:
        value = getattr(ac, name)
        if getattr(value, "__module__", "").split(".")[1:2] == [room]:
            found[name] = value
    at_top = {name for name in ac.__all__ if getattr(ac, name) is found.get(name)}
    return [
        (f"armcontour.{name}" if name in at_top else f"armcontour.{room}.{name}", value)
        for name, value in found.items()
        if inspect.isclass(value) or inspect.isfunction(value)
    ]


def _options(value: Any) -> list[str]:
    """Options of the directive of a name."""
    return ["   :members:"] if inspect.isclass(value) else []


def _first_line(module: Any) -> str:
    """What a module is, in one line."""
    return (module.__doc__ or "").strip().splitlines()[0]


def commands() -> Iterator[tuple[str, str]]:
    """A page for each command with its arguments and options, and one that lists them."""
    import typer.main

    from armcontour.cli.commands import app

    group: Any = typer.main.get_command(app)
    rows = []
    for name, command in group.commands.items():
        yield f"commands/{name}.md", _command(name, command)
        rows.append(f"| [{name}]({name}.md) | {command.help.strip().splitlines()[0]} |")
    toc = "\n".join(group.commands)
    yield (
        "commands/index.md",
        "# Command line\n\n`armcontour --help` lists the commands, `armcontour COMMAND --help` its "
        "options.\n\n| command | what it does |\n|---|---|\n"
        + "\n".join(rows)
        + f"\n\n{group.epilog}\n\n```{{toctree}}\n:hidden:\n\n{toc}\n```\n",
    )


def _command(name: str, command: Any) -> str:
    """The page of a command."""
    arguments = [x for x in command.params if x.param_type_name == "argument"]
    options = [x for x in command.params if x.param_type_name == "option" and not x.hidden]
    usage = " ".join(["armcontour", name, *map(_argument, arguments), "[OPTIONS]"])
    lines = [f"# armcontour {name}", "", command.help.strip(), "", f"    {usage}", ""]
    if arguments:
        lines += ["| argument | |", "|---|---|"]
        lines += [f"| `{_argument(x)}` | {_cell(x.help)} |" for x in arguments]
        lines.append("")
    lines += ["| option | |", "|---|---|"]
    lines += [f"| {_option(x)} | {_cell(x.help)} |" for x in options]
    return "\n".join(lines) + "\n"


def _argument(argument: Any) -> str:
    """How an argument is called."""
    return str(argument.metavar or argument.name.upper())


def _option(option: Any) -> str:
    """All spellings of an option, with its value."""
    value = "" if option.is_flag else f" {option.metavar or str(option.display_type).upper()}"
    return "<br>".join(f"`{x}{value}`" for x in (*option.opts, *option.secondary_opts))


def _cell(text: str | None) -> str:
    """A text in a cell of a table."""
    return (text or "").replace("|", r"\|").replace("\n", " ")


def error_classes() -> Iterator[tuple[str, str]]:
    """A page of all errors with their exit codes."""
    rows = [
        f"| [`{x.__name__}`](#armcontour.{x.__name__}) | {x.exit_code} | "
        f"{(x.__doc__ or '').strip().splitlines()[0]} |"
        for x in vars(errors).values()
        if inspect.isclass(x) and issubclass(x, errors.ArmContourError)
    ]
    yield (
        "errors.md",
        "# Errors and exit codes\n\nEvery error says in one sentence what is wrong, where, and "
        "what would mend it. In Python it is one of these; a command ends with its exit code.\n\n"
        "| error | exit code | |\n|---|---|---|\n" + "\n".join(rows) + "\n",
    )


def project() -> Iterator[tuple[str, str]]:
    """Texts of the repository."""
    for file, name in PROJECT.items():
        yield f"project/{name}.md", (ROOT / file).read_text(encoding="utf-8")
