"""The section on what binds where: why a plan of the method "optimal" is not faster."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.core.render import number
from armcontour.jobs import RunResult, Study
from armcontour.report.figure import make_subplots, make_trace
from armcontour.report.section import Section, table_of
from armcontour.report.sections.motion import assigned_speeds, planned_speeds
from armcontour.report.style import PATH_COLOUR, RUN_COLOURS, finish, line, thin
from armcontour.timing import Explanation
from armcontour.timing.explanation import BETWEEN

# Largest number of listed places below the assigned velocity per run.
MOST_NOTES = 8
# Patterns of bars, when there are more limits than colours.
PATTERNS = ("", "/", "x", ".")
# Largest number of visible bars.
MOST_BARS = 1200
# Relative difference below which assigned velocities are equal.
SAME_SPEED = 1e-9


def bindings(study: Study) -> Section | None:
    """A coloured strip along the path for every optimal run; None without such a run."""
    plans = _plans(study)
    if not plans:
        return None
    return Section(
        key="bindings",
        title="What binds where",
        text=(
            "Above: planned tool speed along the path; below: the limit that keeps it from being "
            f"faster. {BETWEEN.capitalize()}, an optimal plan passes from one to the next."
        ),
        figures=tuple(_strip(*x) for x in plans),
        tables=tuple(table_of(why.to_data().tables[0], name) for name, _, why in plans),
        notes=(
            *(note for x in plans for note in _notes(*x)),
            *(
                f"{name}: of {len(why.bindings)} stretches, the strip shows the longest in each of "
                f"{MOST_BARS} parts of the length."
                for name, _, why in plans
                if len(why.bindings) > MOST_BARS
            ),
        ),
    )


def _plans(study: Study) -> list[tuple[str, RunResult, Explanation]]:
    """Every explained plan once, with the names of all runs that have this plan."""
    found: list[list[RunResult]] = []
    for result in study.runs.values():
        if result.explanation is None:
            continue
        same = next((x for x in found if x[0].trajectory is result.trajectory), None)
        if same is None:
            found.append([result])
        else:
            same.append(result)
    return [(_label_runs(x), x[0], x[0].explanation) for x in found if x[0].explanation is not None]


def _label_runs(results: list[RunResult]) -> str:
    """Names of runs as a title."""
    *first, last = (x.run.name for x in results)
    return f"Runs {', '.join(first)} and {last}" if first else f"Run {last}"


def _notes(name: str, result: RunResult, why: Explanation) -> list[str]:
    """Sentences on the slowest places below the assigned velocity, and the number of others."""
    worst = sorted(why.shortfalls, key=lambda x: x.speed / x.assigned)
    notes = [f"{name}: {x.sentence} ({x.kind})." for x in worst[:MOST_NOTES]]
    if len(worst) > MOST_NOTES:
        notes.append(f"{name}: and {len(worst) - MOST_NOTES} more places.")
    return notes


def _strip(title: str, result: RunResult, why: Explanation) -> Any:
    """Figure of tool speed and binding limits along the path of a run."""
    figure = make_subplots(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.75, 0.25], vertical_spacing=0.05
    )
    for trace in _speeds(result):
        figure.add_trace(trace, row=1, col=1)
    bars = merge_bindings(why)
    for k, name in enumerate(_names(why)):
        figure.add_trace(_bar(name, k, bars.get(name, [])), row=2, col=1)
    figure.update_layout(barmode="overlay", bargap=0)
    figure.update_yaxes(title="speed [mm/s]", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title="binds", row=2, col=1)
    where = "arc length of all contours [m]" if len(result.path.contours) > 1 else "arc length [m]"
    figure.update_xaxes(title=where, row=2, col=1)
    return finish(figure, title=title, height=480)


def _speeds(result: RunResult) -> list[Any]:
    """Curves of planned and assigned tool speed along the path, or along all contours."""
    planned = planned_speeds(result)
    s, speed = thin(planned[0], planned[1] * 1e3)
    found = [line(s, speed, "planned tool speed", "#000000")]
    assigned = assigned_speeds(result)
    if assigned is None:
        return found
    values = assigned[2][np.isfinite(assigned[2])] * 1e3
    name = "assigned velocity"
    if np.ptp(values) <= SAME_SPEED * values.max():
        name += f" {number(assigned[2][0], 'm/s')}"
    s, value = thin(assigned[1], assigned[2] * 1e3)
    return [*found, line(s, value, name, PATH_COLOUR, dash="dash", width=1)]


def _bar(name: str, k: int, bars: list[tuple[float, ...]]) -> Any:
    """Bars of the intervals in which one limit binds."""
    colour = PATH_COLOUR if name == "nothing" else RUN_COLOURS[k % len(RUN_COLOURS)]
    return make_trace(
        "bar",
        name=_label(name),
        orientation="h",
        y=[""] * len(bars),
        base=[x[0] for x in bars],
        x=[x[1] - x[0] for x in bars],
        # Patterns repeat the colours for arms with many limits.
        marker={
            "color": colour,
            "pattern": {"shape": PATTERNS[k // len(RUN_COLOURS) % len(PATTERNS)]},
            # Edges would cover thin bars, also of few.
            "line": {"width": 0},
        },
        customdata=bars,
        hovertemplate=(
            f"{_label(name)}<br>s %{{customdata[0]:.4f}} to %{{customdata[1]:.4f}} m"
            "<br>t %{customdata[2]:.3f} to %{customdata[3]:.3f} s<extra></extra>"
        ),
    )


def merge_bindings(why: Explanation) -> dict[str, list[tuple[float, ...]]]:
    """Start and end of bars along the path [m] and in time [s], by the names of binding limits.

    If there are too many intervals to see, the path is cut into equal parts, and each part has one
    bar: that of its longest interval. Neighbouring bars of one limit are joined.
    """
    names = [x.name for x in why.bindings]
    ends = np.array([(*x.s, *x.t) for x in why.bindings])
    which = np.arange(len(names))
    if len(names) > MOST_BARS:
        cell = np.floor((ends[:, 0] + ends[:, 1]) / 2 / ends[-1, 1] * MOST_BARS).astype(int)
        order = np.lexsort((ends[:, 0] - ends[:, 1], cell))
        which = order[np.flatnonzero(np.diff(cell[order], prepend=-1))]
        # Every bar ends where the next bar starts.
        starts = ends[which][:, [0, 2]]
        starts[0] = ends[0, [0, 2]]
        following = np.concatenate([starts[1:], ends[-1:, [1, 3]]])
        ends = np.stack([starts[:, 0], following[:, 0], starts[:, 1], following[:, 1]], axis=1)
    else:
        ends = ends[which]
    found: dict[str, list[tuple[float, ...]]] = {}
    before = ""
    for i, x in zip(which, ends.tolist(), strict=True):
        name = names[i]
        if len(names) > MOST_BARS and name == before:
            last = found[name][-1]
            found[name][-1] = (last[0], x[1], last[2], x[3])
        else:
            found.setdefault(name, []).append(tuple(x))
        before = name
    return found


def _label(name: str) -> str:
    """Name of a limit in the figures; "nothing" means the transition between two limits."""
    return BETWEEN if name == "nothing" else name


def _names(why: Explanation) -> list[str]:
    """Names of all binding limits in order of appearance, "nothing" last."""
    names = list(dict.fromkeys(x.name for x in why.bindings))
    return sorted(names, key=lambda name: name == "nothing")
