"""Measure everything and print one table, and three of what the planners answered."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from benchmarks import (
    certify,
    jerk,
    kinematics,
    learning,
    optimal,
    polyline,
    program,
    projection,
    shaping,
    spread,
    square,
    start_up,
)


def main() -> None:
    """Run all benchmarks."""
    console = Console(width=140)
    plans, judged, notes = optimal.measure()
    polylines, more = polyline.measure()
    solved, guessed = kinematics.measure()
    squares, around, settings = square.measure()
    executed, rates = spread.measure()
    programs, long = program.measure()
    shaped, shapes, corners = shaping.measure()
    jerky, missing = jerk.measure()
    table = Table(title="armcontour benchmarks", title_justify="left")
    for name in ("what", "ours [ms]", "peer", "peer [ms]", "ratio", "bar"):
        table.add_column(name)
    smaller = [*start_up.measure(), *projection.measure(), *certify.measure(), *learning.measure()]
    rows = [*smaller, *plans, *polylines, *solved, *squares, *executed, *programs, *shaped, *jerky]
    for measured in rows:
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
    drawn = Table(title="plans of the square", title_justify="left")
    for name in ("planner", "duration [s]", "corner error [mm]", "off the square [mm]"):
        drawn.add_column(name)
    for name in ("tool speed [m/s]", "joint limits used", "through its samples"):
        drawn.add_column(name)
    for plan in around:
        lengths = f"{plan.corner * 1e3:.3f}", f"{plan.off * 1e3:.3f}"
        shares = f"{plan.speed:.4f}", f"{plan.law:.3f}", f"{plan.executed:.3f}"
        drawn.add_row(plan.who, f"{plan.duration:.4f}", *lengths, *shares)
    console.print(drawn)
    motions = Table(title="shaped paths [s]", title_justify="left")
    for name in ("what", "arcs", "shaped", "start", "bar", "oracle"):
        motions.add_column(name)
    for x in shapes:
        motions.add_row(x.what, f"{x.arcs:.4f}", f"{x.shaped:.4f}", x.start, x.bar, x.oracle)
    console.print(motions)
    for note in [*notes, *more, *guessed, *settings, *rates, *long, *corners, *missing]:
        console.print(note)


main()
