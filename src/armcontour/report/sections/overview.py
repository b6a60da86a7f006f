"""The first section: every run in a few figures."""

from __future__ import annotations

from itertools import permutations

from armcontour.jobs import RunResult, Study, same_plan
from armcontour.jobs.quantities import assumed_numbers
from armcontour.report.planned import torques_of
from armcontour.report.section import Section, Table, Tile
from armcontour.report.style import few

# So many runs have tiles; more are compared in a table.
MOST_TILED = 2
MASSES = "What torques and experiments assume about masses: see Drive torques."
# A joint counts as saturated from this share of the time on; below, it would show as 0.0%.
SATURATED = 5e-4


def overview(study: Study) -> Section:
    """How long, how exact, how hard: figures of every run, beside each other if there are many."""
    many = len(study.runs) > MOST_TILED
    return Section(
        key="overview",
        title="At a glance",
        text=(
            "Contour error is the distance from the tool to the path it was to follow, as executed "
            "on the simulated servo with its acceleration limit."
        ),
        tiles=() if many else tuple((name, _tiles(x)) for name, x in study.runs.items()),
        tables=(_compare(study),) if many else (),
        notes=(
            *(x for y in study.runs.values() for x in few(y.warnings, f"warnings of {y.run.name}")),
            *(
                f"Run {name}: {result.failure}"
                for name, result in study.runs.items()
                if result.failure is not None
            ),
            *_worse_on_bodies(study),
            *((MASSES,) if many and assumed_numbers(study.job.arm) else ()),
        ),
    )


def _compare(study: Study) -> Table:
    """A row for every run, and a column for every figure that any of them has."""
    found = {name: {x.label: x.value for x in _tiles(y)} for name, y in study.runs.items()}
    labels = list(dict.fromkeys(label for values in found.values() for label in values))
    rows = []
    for name, values in found.items():
        result = study.runs[name]
        settled = f"{result.evaluation.settled:.3f} s"
        cells = [values.get(label, "") for label in labels]
        rows.append((name, cells[0], settled, *cells[1:], _shares(result) or "no joint"))
    return Table(header=("run", labels[0], "at rest", *labels[1:], "saturated"), rows=tuple(rows))


def _worse_on_bodies(study: Study) -> list[str]:
    """Runs whose compensation does harm on rigid bodies, beside the same plan without any."""
    notes = []
    for plain, made_up in permutations(study.runs.values(), 2):
        if plain.run.compensation != "none" or made_up.run.compensation == "none":
            continue
        if plain.experiment is None or made_up.experiment is None or not same_plan(plain, made_up):
            continue
        without = plain.experiment.evaluation.contour_error.rms
        error = made_up.experiment.evaluation.contour_error.rms
        if error > without:
            notes.append(
                f"On rigid bodies the run {made_up.run.name} is farther from the path than "
                f"{plain.run.name}, which is the same plan without compensation "
                f"(RMS {error * 1e3:.4f} mm, not {without * 1e3:.4f} mm): the compensation is made "
                "for the servo's gains, but on the bodies the loops are faster or slower than "
                "these, by the nominal inertia over the real one, so it leads the joints by too "
                "much or too little."
            )
    return notes


def _tiles(result: RunResult) -> tuple[Tile, ...]:
    e = result.evaluation
    worst = int(e.demand_ratio.argmax())
    names = result.execution.arm.joint_names
    tiles = [
        Tile(label="motion", value=f"{e.duration:.3f} s", note=f"at rest after {e.settled:.3f} s"),
        Tile(
            label="contour error, RMS",
            value=f"{e.contour_error.rms * 1e3:.4f} mm",
            note=f"over {_judged_time(result):.2f} s"
            + (" on contours" if len(e.contours) > 1 else ""),
        ),
        Tile(
            label="contour error, largest",
            value=f"{e.contour_error.max * 1e3:.4f} mm",
            note=f"at {e.contour_error.t_max:.2f} s, s = {e.contour_error.s_max:.3f} m",
        ),
        Tile(
            label="joint demand / limit",
            value=_ratio(float(e.demand_ratio[worst])),
            note=f"{names[worst]}; {_saturated(result)}",
        ),
        Tile(
            label="joints fully used",
            value=f"{e.utilisation:.0%}",
            note="of the motion: some joint within 1 % of a limit",
        ),
    ]
    if result.path.single_path is None:
        tiles.append(
            Tile(
                label="tool speed on contours, largest",
                value=f"{e.speed * 1e3:.1f} mm/s",
                note=f"at most {e.speed_overshoot * 1e3:.2g} mm/s over what is assigned",
            )
        )
    elif e.speed_ratio == e.speed_ratio:
        tiles.append(
            Tile(
                label="tool speed / assigned",
                value=_ratio(e.speed_ratio),
                note=f"largest {e.speed * 1e3:.1f} mm/s, mean {e.path_velocity * 1e3:.1f} mm/s",
            )
        )
    return (*tiles, *_torque(result), *_experiment(result))


def _judged_time(result: RunResult) -> float:
    """Time that errors cover [s], contour by contour."""
    return sum(float(x.t[-1] - x.t[0]) for x in result.evaluation.contours)


def _saturated(result: RunResult) -> str:
    shares = _shares(result)
    return f"saturated: {shares} of the time" if shares else "no joint saturated"


def _shares(result: RunResult) -> str:
    """Which joints were saturated, and for how much of the time."""
    shares = zip(result.execution.arm.joint_names, result.evaluation.saturated, strict=True)
    return ", ".join(f"{name} {share:.1%}" for name, share in shares if share >= SATURATED)


def _torque(result: RunResult) -> list[Tile]:
    """The largest share of a drive's torque that the plan takes, where both are known."""
    limit, plan = result.run.limits.joint_torque, torques_of(result)
    if limit is None or plan is None:
        return []
    share = plan.peak / limit
    worst = int(share.argmax())
    name = result.execution.arm.joint_names[worst]
    note = f"{name}: {plan.peak[worst]:.4g} of {limit[worst]:.4g} N m, planned"
    return [
        Tile(
            label="drive torque / limit",
            value=_ratio(float(share[worst])),
            note=note + _rests(result),
        )
    ]


def _experiment(result: RunResult) -> list[Tile]:
    label = "experiment: contour error, RMS"
    if result.failure is not None:
        return [Tile(label=label, value="failed", note="see below")]
    if result.experiment is None:
        return []
    e = result.experiment.evaluation.contour_error
    note = f"largest {e.max * 1e3:.4f} mm, on rigid bodies{_rests(result)}"
    return [Tile(label=label, value=f"{e.rms * 1e3:.4f} mm", note=note)]


def _rests(result: RunResult) -> str:
    return "; masses: see Drive torques" if assumed_numbers(result.execution.arm) else ""


def _ratio(value: float) -> str:
    return f"{value:.3f}" if value < 10 else f"{value:.4g}"
