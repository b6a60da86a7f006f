"""What binds where: why a plan of the method "optimal" is not faster."""

from __future__ import annotations

from typing import Any

from armcontour.motion import PathLaw
from armcontour.report.section import Section, Table
from armcontour.report.style import PATH_COLOUR, RUN_COLOURS, finish, line
from armcontour.study import RunResult, Study, same_plan
from armcontour.timing import Explanation

# A run's places below the assigned velocity are listed up to this number.
MOST_NOTES = 8
BETWEEN = "between two limits"
# Told apart beside the colours.
PATTERNS = ("", "/", "x", ".")


def bindings(study: Study) -> Section | None:
    """A coloured strip along the path for every optimal run; None if there is none."""
    plans = _plans(study)
    if not plans:
        return None
    return Section(
        key="bindings",
        title="What binds where",
        text=(
            "Above: planned tool speed along the path; below: the limit that keeps it from being "
            f"faster. Where it is {BETWEEN}, an optimal plan passes from one to the next."
        ),
        figures=tuple(_strip(*x) for x in plans),
        tables=tuple(_table(*x) for x in plans),
        notes=tuple(note for x in plans for note in _notes(*x)),
    )


def _plans(study: Study) -> list[tuple[str, RunResult, Explanation]]:
    """Every explained plan once, under the names of all runs that have it."""
    found: list[list[RunResult]] = []
    for result in study.runs.values():
        if result.explanation is None:
            continue
        same = next((x for x in found if same_plan(x[0], result)), None)
        if same is None:
            found.append([result])
        else:
            same.append(result)
    return [(_called(x), x[0], x[0].explanation) for x in found if x[0].explanation is not None]


def _called(results: list[RunResult]) -> str:
    *first, last = (x.run.name for x in results)
    return f"Runs {', '.join(first)} and {last}" if first else f"Run {last}"


def _notes(name: str, result: RunResult, why: Explanation) -> list[str]:
    """Where the assigned velocity is not reached: the slowest places first, and how many more."""
    worst = sorted(why.shortfalls, key=lambda x: x.speed / x.assigned)
    notes = [f"{name}: {x.sentence} ({x.kind})." for x in worst[:MOST_NOTES]]
    if len(worst) > MOST_NOTES:
        notes.append(f"{name}: and {len(worst) - MOST_NOTES} more places.")
    return notes


def _strip(title: str, result: RunResult, why: Explanation) -> Any:
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
                name=_label(name),
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
                    f"{_label(name)}<br>s %{{customdata[0]:.4f}} to %{{customdata[1]:.4f}} m"
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
    return finish(figure, title=title, height=480)


def _label(name: str) -> str:
    """What a limit is called in the figures; "nothing" is the way from one to the next."""
    return BETWEEN if name == "nothing" else name


def _names(why: Explanation) -> list[str]:
    """What binds anywhere, in order of first appearance, "nothing" last."""
    names = list(dict.fromkeys(x.name for x in why.bindings))
    return sorted(names, key=lambda name: name == "nothing")


def _table(title: str, result: RunResult, why: Explanation) -> Table:
    """Share of length and time per limit."""
    length, duration = result.path.length, result.trajectory.duration
    rows = []
    for name in _names(why):
        of = [x for x in why.bindings if x.name == name]
        rows.append(
            (
                _label(name),
                f"{sum(x.s[1] - x.s[0] for x in of) / length:.1%}",
                f"{sum(x.t[1] - x.t[0] for x in of) / duration:.1%}",
                str(len(of)),
            )
        )
    return Table(
        header=("limit", "of the length", "of the time", "stretches"),
        rows=tuple(rows),
        caption=title,
    )
