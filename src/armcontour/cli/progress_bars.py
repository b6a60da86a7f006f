"""Progress on the standard error: a bar on a terminal, otherwise a line every EVERY seconds."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from armcontour.cli.console import print_lines
from armcontour.core.progress import COMPILING, Progress, Step, listen_to_compilation
from armcontour.core.text import to_line

# Minimum time between progress lines, and before the first line, without a terminal [s].
EVERY = 10.0


@contextmanager
def show_progress(title: str = "") -> Iterator[Progress]:
    """Context that shows the current step and its completed fraction; yields its update function.

    A bar is removed at the end.
    """
    from rich import progress as bars
    from rich.console import Console

    console, last = Console(stderr=True), time.monotonic()
    bar = bars.Progress(
        bars.SpinnerColumn(),
        bars.TextColumn("{task.description}", markup=False),
        bars.BarColumn(),
        bars.TaskProgressColumn(),
        bars.TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )

    def show(step: Step) -> None:
        nonlocal last
        text = to_line(f"{title}: {step}".removeprefix(": "))
        total = None if step.done is None else 1.0
        bar.update(task, description=text, completed=step.done or 0.0, total=total)
        if bar.disable and time.monotonic() >= last + EVERY:
            last = time.monotonic()
            print_lines(text if step.done is None else f"{text}, {step.done:.0%}", err=True)

    task = bar.add_task(title, total=None)
    with bar, listen_to_compilation(lambda name: show(Step((COMPILING, name)))):
        yield show


@contextmanager
def compiling_notice() -> Iterator[None]:
    """Context that writes one line before the first function is compiled."""
    names: list[str] = []

    def say(name: str) -> None:
        if not names:
            # `name` can be the number of functions of a run, of which some may be compiled already.
            subject = f"up to {name}" if name[:1].isdigit() else "functions"
            print_lines(
                f"Compiling {subject}, because no earlier command has used them. This happens only "
                "once. `armcontour compile` compiles all functions in advance.",
                err=True,
            )
        names.append(name)

    with listen_to_compilation(say):
        yield
