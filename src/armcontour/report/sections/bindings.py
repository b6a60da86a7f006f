"""What binds where: why a plan of the method "optimal" is not faster."""

from __future__ import annotations

from typing import Any

from armcontour.motion import PathLaw
from armcontour.report.section import Section, Table
from armcontour.report.style import PATH_COLOUR, RUN_COLOURS, finish, line
from armcontour.study import RunResult, Study
from armcontour.timing import Explanation

# A run's places below the assigned velocity are listed up to this number.
MOST_NOTES = 8
# Told apart beside the colours.
PATTERNS = ("", "/", "x", ".")


def bindings(study: Study) -> Section | None:
    """A coloured strip along the path for every optimal run; None if there is none."""
    explained = [(x, x.explanation) for x in study.runs.values() if x.explanation is not None]
    if not explained:
        return None
    return Section(
        key="bindings",
        title="What binds where",
        text=(
            "An optimal plan always has a limit that binds. Above: planned tool speed along the "
            "path; below: the limit that keeps it from being faster."
        ),
        figures=tuple(_strip(result, why) for result, why in explained),
        tables=tuple(_table(result, why) for result, why in explained),
        notes=tuple(note for result, why in explained for note in _notes(result, why)),
    )


def _notes(result: RunResult, why: Explanation) -> list[str]:
    """Where the assigned velocity is not reached: the slowest places first, and how many more."""
    worst = sorted(why.shortfalls, key=lambda x: x.speed / x.assigned)
    notes = [f"{result.run.name}: {x.sentence} ({x.kind})." for x in worst[:MOST_NOTES]]
    if len(worst) > MOST_NOTES:
        notes.append(f"{result.run.name}: and {len(worst) - MOST_NOTES} more places.")
    return notes


def _strip(result: RunResult, why: Explanation) -> Any:
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.75, 0.25], vertical_spacing=0.05
    )
    law = result.trajectory.laws[0]
    if isinstance(law, PathLaw):
        figure.add_trace(
            line(law.s, law.speeds * 1e3, "planned tool speed", "#000000"), row=1, col=1
        )
    if result.run.limits.speed is not None:
        assigned = result.run.limits.speed * 1e3
        figure.add_trace(
            line(
                [0, result.path.length],
                [assigned] * 2,
                f"assigned velocity {assigned:g} mm/s",
                PATH_COLOUR,
                dash="dash",
                width=1,
            ),
            row=1,
            col=1,
        )
    for k, name in enumerate(_names(why)):
        of = [x for x in why.bindings if x.name == name]
        figure.add_trace(
            go.Bar(
                name=name,
                orientation="h",
                y=[""] * len(of),
                base=[x.s[0] for x in of],
                x=[x.s[1] - x.s[0] for x in of],
                marker={
                    "color": PATH_COLOUR
                    if name == "nothing"
                    else RUN_COLOURS[k % len(RUN_COLOURS)],
                    # Many joints have more limits than there are colours.
                    "pattern": {"shape": PATTERNS[k // len(RUN_COLOURS) % len(PATTERNS)]},
                },
                customdata=[[*x.s, *x.t] for x in of],
                hovertemplate=(
                    f"{name}<br>s %{{customdata[0]:.4f}} to %{{customdata[1]:.4f}} m"
                    "<br>t %{customdata[2]:.3f} to %{customdata[3]:.3f} s<extra></extra>"
                ),
            ),
            row=2,
            col=1,
        )
    figure.update_layout(barmode="overlay", bargap=0)
    figure.update_yaxes(title="speed [mm/s]", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title="binds", row=2, col=1)
    figure.update_xaxes(title="arc length [m]", row=2, col=1)
    return finish(figure, title=f"Run {result.run.name}", height=480)


def _names(why: Explanation) -> list[str]:
    """What binds anywhere, in order of first appearance, "nothing" last."""
    names = list(dict.fromkeys(x.name for x in why.bindings))
    return sorted(names, key=lambda name: name == "nothing")


def _table(result: RunResult, why: Explanation) -> Table:
    """Share of length and time per limit."""
    length, duration = result.path.length, result.trajectory.duration
    rows = []
    for name in _names(why):
        of = [x for x in why.bindings if x.name == name]
        rows.append(
            (
                name,
                f"{sum(x.s[1] - x.s[0] for x in of) / length:.1%}",
                f"{sum(x.t[1] - x.t[0] for x in of) / duration:.1%}",
                str(len(of)),
            )
        )
    return Table(
        header=("limit", "of the length", "of the time", "stretches"),
        rows=tuple(rows),
        caption=f"Run {result.run.name}",
    )
