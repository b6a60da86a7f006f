"""The program `armcontour`: its help, and the decorator that registers a command."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import typer

from armcontour._version import __version__
from armcontour.cli.options import Command, CommandGroup, grouped

# Topics under which the help lists the commands.
RUN, PREPARE, JUDGE = "Plan and run", "Look, place, prepare", "Check and certify"
ROBOT, INSTALLED = "With the robot", "About this installation"


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


def command(topic: str, example: str, name: str | None = None) -> Callable[[Any], Any]:
    """Decorator that registers a command, which returns its exit code; None means 0."""

    def register(function: Callable[..., int | None]) -> Callable[..., int | None]:
        call = grouped(function)

        def call_and_exit(**options: Any) -> None:
            raise typer.Exit(call(**options) or 0)

        call_and_exit.__signature__ = call.__signature__  # type: ignore[attr-defined]
        called, text = name or function.__name__, f"\b\nExample:\n  armcontour {example}"
        add = program.command(
            called, cls=Command, help=function.__doc__, rich_help_panel=topic, epilog=text
        )
        add(call_and_exit)
        return function

    return register


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
