"""Measure everything and print one table, and one of what the planners answered."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from benchmarks import optimal, polyline, projection, start_up


def main() -> None:
    """Run all benchmarks."""
    console = Console(width=140)
    plans, judged, notes = optimal.measure()
    polylines, more = polyline.measure()
    table = Table(title="armcontour benchmarks", title_justify="left")
    for name in ("what", "ours [ms]", "peer", "peer [ms]", "ratio", "bar"):
        table.add_column(name)
    for measured in [*start_up.measure(), *projection.measure(), *plans, *polylines]:
        table.add_row(
            measured.what,
            f"{measured.ours * 1e3:.3g}",
            measured.peer,
            f"{measured.peer_time * 1e3:.3g}",
            f"{measured.ours / measured.peer_time:.3g}",
            measured.bar,
        )
    console.print(table)
    answers = Table(title="optimal plans", title_justify="left")
    for name in ("points", "planner", "duration [s]", "largest violation"):
        answers.add_column(name)
    for answer in judged:
        answers.add_row(
            str(answer.points), answer.who, f"{answer.duration:.6f}", f"{answer.violation:.1e}"
        )
    console.print(answers)
    for note in [*notes, *more]:
        console.print(note)


main()
