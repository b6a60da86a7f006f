"""The program `armcontour`: its help, and the decorator that makes a command of a dataclass."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import MISSING, dataclass, field, fields
from functools import partial
from importlib import import_module
from inspect import Parameter, Signature, cleandoc
from pathlib import Path as FilePath
from typing import Annotated, Any, TypeVar, dataclass_transform, get_origin, get_type_hints

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from armcontour._version import __version__
from armcontour.cli.command_execution import Outcome, execute
from armcontour.cli.job_options import JOB_OPTIONS, Topic
from armcontour.core.errors import InvalidInput
from armcontour.core.text import describe_fields

T = TypeVar("T")
# Topics under which the help lists the commands.
RUN = "Plan and run"
PREPARE = "Look, place, prepare"
JUDGE = "Check and certify"
ROBOT = "With the robot"
INSTALLED = "About this installation"
# Functions that convert texts to option types for which no check is needed.
CONVERTERS: dict[Any, Callable[[Any], Any]] = {
    str: str,
    FilePath: FilePath,
    list[str]: list,
    list[FilePath]: lambda texts: [FilePath(x) for x in texts],
}
# Functions that register the commands, by name in the order of the help.
_REGISTER: dict[str, Callable[[], None]] = {}


def _write_panels(self: Any, ctx: Any, formatter: Any) -> None:
    """Write arguments, options and commands of a help text in panels."""
    # Typer itself writes panels only with the library `rich`, which doubles the time of the help,
    # truncates long options in narrow terminals and removes units in square brackets as markup.
    panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for x in self.get_params(ctx):
        if (record := x.get_help_record(ctx)) is not None:
            panel = "Arguments" if isinstance(x, TyperArgument) else x.rich_help_panel or "Options"
            panels.setdefault(panel, []).append(record)
    for name, called in getattr(self, "commands", {}).items():
        row = f"{name:<8}", called.get_short_help_str(200)
        panels.setdefault(called.rich_help_panel, []).append(row)
    for title, rows in panels.items():
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)


@dataclass(frozen=True)
class _Converter:
    """Converts the texts of an option without typer, which would import pydantic (0.1 s)."""

    convert: Callable[[Any], Any]

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value of an option to typer; None or an empty tuple if it is not given."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        return self.convert(value)


def _given_parameters(command: Any, ctx: Any, args: list[str]) -> list[Any]:
    """Return the parameters in the order of the arguments; sets how typer converts values."""
    *_, given = command.make_parser(ctx).parse_args(list(args))
    for x in command.get_params(ctx):
        # Older versions of typer have neither type descriptors nor pydantic.
        kind = getattr(getattr(x, "type_descriptor", None), "annotation", None)
        convert = CONVERTERS.get(kind) if x in given else lambda value: value
        if convert is not None:
            x.get_runtime_param = partial(_Converter, convert)
    return list(given)


class CommandGroup(TyperGroup):
    """Group of commands whose help has panels."""

    format_options = _write_panels

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options of the program."""
        _given_parameters(self, ctx, args)
        return super().parse_args(ctx, args)


class Command(TyperCommand):
    """Command whose help has panels, and that refuses repeated options."""

    format_options = _write_panels

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; refuse an option with one value that is specified several times."""
        parameters = _given_parameters(self, ctx, args)
        for x in parameters:
            single = isinstance(x, TyperOption) and not (x.multiple or x.is_flag)
            if single and (times := parameters.count(x)) > 1:
                name = max(x.opts, key=len)
                raise InvalidInput(f"{name} has one value, but is specified {times} times.")
        return super().parse_args(ctx, args)


program = typer.Typer(
    name="armcontour",
    help="Contouring with industrial robot arms: as fast as the limits allow, within the error.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=(
        "Exit codes: 0 done; 1 not kept, not determined, or refused by the system; 2 invalid "
        "input; 3 out of reach; 4 no timing or certificate; 5 delay not compensated; 6 simulation "
        "not completed; 7 cannot tell; 8 collision; 9 provisional; 10 robot differs; "
        "11 robot lost; 130, 141 and 143 interrupted. "
        "Example: armcontour run gasket.dxf --cell ur5e --out gasket"
    ),
    cls=CommandGroup,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def program_for(arguments: Sequence[str] = ()) -> typer.Typer:
    """Return the program with the called command only, because reading all options takes time.

    Args:
        arguments: Arguments of the program. If the first is not a command, all commands are
            registered.
    """
    program.registered_commands.clear()
    for name in [x for x in arguments[:1] if x in _REGISTER] or _REGISTER:
        _REGISTER[name]()
    return program


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
def command(topic: str, example: str, module: str = "") -> Callable[[type[T]], type[T]]:
    """Decorator that makes a dataclass and its command: its fields are arguments and options.

    The docstring of the class is the help. The command calls the function of its name in a module,
    which is imported only then.

    Args:
        topic: Topic under which the help lists the command.
        example: Arguments of the example in the help.
        module: Name of the module; by default the command's name and `_command`, such as
            `run_command`.
    """

    def declare(declared: type[T]) -> type[T]:
        """Make the class a dataclass of options, and register its command."""
        options = dataclass(frozen=True, kw_only=True, eq=False, repr=False)(declared)
        name = options.__name__.lower()

        def work(*arguments: Any) -> Outcome:
            command_module = import_module(f"armcontour.cli.{module or name + '_command'}")
            outcome: Outcome = getattr(command_module, name)(*arguments)
            return outcome

        def call(**values: Any) -> None:
            """Execute the command with the values of its parameters, and exit with its code."""
            keys = {x: values.pop(x) for x in JOB_OPTIONS if x in values}
            if keys:
                values["keys"] = keys
            raise typer.Exit(execute(work, options(**values)))

        def register() -> None:
            """Add the command to the program, with the fields of the class as its parameters."""
            call.__signature__ = Signature(list(_parameters(options)))  # type: ignore[attr-defined]
            program.command(
                name,
                cls=Command,
                help=cleandoc(options.__doc__ or "").partition("\nArgs:\n")[0],
                rich_help_panel=topic,
                epilog=f"\b\nExample:\n  armcontour {example}",
            )(call)

        _REGISTER[name] = register
        return options

    return declare


def _find_panels(options: Any) -> dict[str, str]:
    """Return the panel of each inherited option: the first sentence of the base's docstring."""
    panels: dict[str, str] = {}
    for base in reversed(options.__mro__[1:]):
        first_sentence = (base.__doc__ or "").partition(".")[0]
        panels |= dict.fromkeys(vars(base).get("__annotations__", ()), first_sentence)
    return panels


def _parameters(options: Any) -> Iterator[Parameter]:
    """Yield the arguments and options of a dataclass as parameters that typer reads.

    The help of an option is its entry in a docstring. Its panel is the first sentence in the
    docstring of the base class that declares it.
    """
    hints = get_type_hints(options, include_extras=True)
    texts = describe_fields(options)
    panels = _find_panels(options)
    for x in fields(options):
        hint = hints[x.name]
        if x.name == "keys":
            yield from _job_parameters(hint.__metadata__)
            continue
        option = typer.Option(f"--{x.name}")
        if get_origin(hint) is Annotated:
            option = copy(hint.__metadata__[0])
            hint = hint.__origin__
        option.help = texts[x.name]
        option.rich_help_panel = panels.get(x.name)
        default = Parameter.empty if x.default is MISSING else x.default
        yield _parameter(x.name, hint, option, default)


def _job_parameters(topics: Iterable[Topic]) -> Iterator[Parameter]:
    """Yield the options that set keys of a job as parameters that typer reads."""
    for topic in topics:
        for x in topic.options:
            option = typer.Option(x.name, help=x.help, min=x.least)
            option.rich_help_panel = topic.title
            yield _parameter(x.parameter, x.kind | None, option, None)


def _parameter(name: str, hint: Any, option: Any, default: Any) -> Parameter:
    """Return a parameter of a command; `option` is typer's description of it."""
    return Parameter(
        name, Parameter.KEYWORD_ONLY, annotation=Annotated[hint, option], default=default
    )


def _version(value: bool) -> None:
    """Print the version and exit."""
    if value:
        typer.echo(f"armcontour {__version__}")
        raise typer.Exit


@program.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", "-V", help="Print the version.", callback=_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Options of the program."""
