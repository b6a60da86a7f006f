"""Measure everything and print one table."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from benchmarks import projection, start_up


def main() -> None:
    """Run all benchmarks."""
    table = Table(title="armcontour benchmarks", title_justify="left")
    for name in ("what", "ours [ms]", "peer", "peer [ms]", "ratio", "bar"):
        table.add_column(name)
    for measured in [*start_up.measure(), *projection.measure()]:
        table.add_row(
            measured.what,
            f"{measured.ours * 1e3:.3g}",
            measured.peer,
            f"{measured.peer_time * 1e3:.3g}",
            f"{measured.ours / measured.peer_time:.3g}",
            measured.bar,
        )
    Console(width=140).print(table)


main()
