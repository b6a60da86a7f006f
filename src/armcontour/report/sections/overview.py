"""The first section: the most important figures of every run."""

from __future__ import annotations

import numpy as np

from armcontour._describing import digits, several
from armcontour.evaluation import Evaluation
from armcontour.jobs import RunResult, Study, warnings_of
from armcontour.jobs.quantities import assumed_numbers, planned_torques
from armcontour.report.section import Section, Table, Tile
from armcontour.report.sections.bindings import assigned_share
from armcontour.report.style import few

# Largest number of runs with tiles; more runs are compared in a table.
MOST_TILED = 2
# Share of the time from which a joint is shown as saturated; less would show as 0.0%.
SATURATED = 5e-4
# A smaller share of the largest tool speed is rounding of the simulation.
SEEN = 1e-5


def overview(study: Study) -> Section:
    """Duration, errors and demand of every run, as tiles or in a table."""
    many = len(study.runs) > MOST_TILED
    uses_masses = any(
        x.run.experiment is not None or x.run.limits.joint_torque is not None
        for x in study.runs.values()
    )
    assumed = assumed_numbers(study.job.arm)
    return Section(
        key="overview",
        title="At a glance",
        text=_text(study),
        tiles=() if many else tuple((name, _tiles(x)) for name, x in study.runs.items()),
        tables=(_compare(study),) if many else (),
        notes=(
            *few(dict.fromkeys(z for y in study.runs.values() for z in y.path.remarks), "notes"),
            *(y.stops_note for y in study.runs.values() if y.stops_note is not None),
            *few(warnings_of(study.runs.values()), "warnings"),
            *(
                f"Run {name}: {result.failure}"
                for name, result in study.runs.items()
                if result.failure is not None
            ),
            *((f"About the masses: {assumed}",) if assumed and uses_masses else ()),
        ),
    )


def _text(study: Study) -> str:
    """What the figures are of."""
    if not study.simulated:
        return "The plan. No servo was simulated, so that there are no errors."
    text = "Contour error is the distance from the executed tool to its path"
    if study.job.plant_servo.order == "unknown":
        return f"{text}."
    return (
        f"{text}, simulated with servos of {study.job.plant_servo} and their acceleration limits. "
        "It is larger on a robot with other gains."
    )


def _compare(study: Study) -> Table:
    """A row for every run, and a column for every figure that a run has."""
    found = {name: {x.label: x.value for x in _tiles(y)} for name, y in study.runs.items()}
    labels = list(dict.fromkeys(label for values in found.values() for label in values))
    rows = []
    for name, values in found.items():
        result = study.runs[name]
        settled = "-" if result.evaluation is None else f"{result.evaluation.settled:.3f} s"
        cells = [values.get(label, "") for label in labels]
        saturated = "-" if result.evaluation is None else _shares(result) or "no joint"
        rows.append((name, cells[0], settled, *cells[1:], saturated))
    return Table(header=("run", labels[0], "at rest", *labels[1:], "saturated"), rows=tuple(rows))


def _jerk(result: RunResult) -> list[Tile]:
    """The executed jerk of the joint that comes nearest to its limit of jerk, if there are such."""
    e, limit = result.evaluation, result.run.limits.joint_jerk
    if limit is None or not np.isfinite(limit).any():
        return []
    worst = int(e.jerk_ratio.argmax())
    name, jerk = result.arm.joint_names[worst], float(e.jerk[worst])
    return [
        Tile(
            label="joint jerk / limit",
            value=_ratio(float(e.jerk_ratio[worst])),
            note=f"{name}; {jerk:.4g} rad/s³ over one command interval",
        )
    ]


def _commands(result: RunResult) -> list[Tile]:
    """The tile of the command limits, if the run has some: their use, and their cost."""
    use, cost = result.taught.command_use, result.taught.limit_cost
    if not use:
        return []
    name = max(use, key=lambda x: use[x].max())
    joint = result.arm.joint_names[int(use[name].argmax())]
    return [
        Tile(
            label="set-points / command limit",
            value=_ratio(float(use[name].max())),
            note=f"{joint}, {name.replace('_', ' ')}"
            + ("; no set-point is changed" if cost is None else f"; changed by {cost}"),
        )
    ]


def _tiles(result: RunResult) -> tuple[Tile, ...]:
    """Tiles of one run."""
    e = result.evaluation
    if e is None:
        return _planned(result)
    worst = int(e.demand_ratio.argmax())
    names = result.arm.joint_names
    tiles = [
        Tile(label="motion", value=f"{e.duration:.3f} s", note=f"at rest after {e.settled:.3f} s"),
        Tile(
            label="contour error, RMS",
            value=f"{e.contour_error.rms * 1e3:.4f} mm",
            note=f"over {_judged_time(result):.2f} s"
            + (" on contours" if len(e.contours) > 1 else "")
            + (", on the servo model, which has no bodies" if result.for_bodies else ""),
        ),
        Tile(
            label="contour error, largest",
            value=f"{e.contour_error.max * 1e3:.4f} mm",
            note=f"at {e.contour_error.t_max:.2f} s, s = {e.contour_error.s_max:.3f} m",
        ),
        Tile(
            label="joint demand / limit",
            value=_ratio(float(e.demand_ratio[worst])) if e.demand_ratio.any() else "no limit",
            note=f"{names[worst]}; {_saturated(result)}"
            if e.demand_ratio.any()
            else "the arm has no limits of joint acceleration or torque",
        ),
        *_jerk(result),
        *_commands(result),
        Tile(
            label="joints fully used",
            value="-" if e.utilisation is None else f"{e.utilisation:.0%}",
            note="of the motion: some joint within 1 % of a limit",
        ),
        Tile(
            label="path missed, largest",
            value=f"{e.missed.max * 1e3:.4f} mm",
            note=f"from s = {e.missed.s_max:.3f} m of the path to the tool",
        ),
        *_orientation(e),
    ]
    if result.path.single_path is None:
        tiles.append(
            Tile(
                label="tool speed on contours, largest",
                value=f"{e.speed * 1e3:.1f} mm/s",
                note=_over_assigned(e),
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
    if result.for_bodies:
        # What judges the run comes first, behind its duration.
        return (tiles[0], *_experiment(result), *tiles[1:], *_torque(result))
    return (*tiles, *_torque(result), *_experiment(result))


def _planned(result: RunResult) -> tuple[Tile, ...]:
    """Tiles of one run that was not executed."""
    plan = result.trajectory
    return (
        Tile(label="motion", value=f"{plan.duration:.3f} s", note=f"method {plan.method}"),
        Tile(
            label="path",
            value=f"{result.path.length:.4g} m",
            note=several(len(result.path.contours), "contour"),
        ),
        Tile(
            label="tool speed, largest",
            value=f"{float(result.motion.tool_speed.max()) * 1e3:.1f} mm/s",
        ),
        *assigned_share(result.explanation, "of the length", "of the time"),
        *_torque(result),
    )


def _orientation(e: Evaluation) -> list[Tile]:
    """Tile of the orientation error; empty for a path without orientation."""
    error = e.orientation_error
    if error is None:
        return []
    return [
        Tile(
            label="orientation error, largest",
            value=f"{np.degrees(error.max):.4f} deg",
            note=f"at {error.t_max:.2f} s, s = {error.s_max:.3f} m",
        )
    ]


def _over_assigned(e: Evaluation) -> str:
    """By how much the tool is faster than assigned, if that can be seen."""
    if e.speed_overshoot <= SEEN * e.speed:
        return "nowhere above what is assigned"
    return f"at most {digits(e.speed_overshoot * 1e3, 2)} mm/s over what is assigned"


def _judged_time(result: RunResult) -> float:
    """Time over which errors are evaluated, summed over contours [s]."""
    return sum(float(x.t[-1] - x.t[0]) for x in result.evaluation.contours)


def _saturated(result: RunResult) -> str:
    """A phrase on the saturation of joints."""
    shares = _shares(result)
    return f"saturated: {shares} of the time" if shares else "no joint saturated"


def _shares(result: RunResult) -> str:
    """Saturated joints, and their shares of the time."""
    shares = zip(result.arm.joint_names, result.evaluation.saturated, strict=True)
    return ", ".join(f"{name} {share:.1%}" for name, share in shares if share >= SATURATED)


def _torque(result: RunResult) -> list[Tile]:
    """Tile of the largest planned share of a torque limit; empty without bodies or limits."""
    limit = result.run.limits.joint_torque
    plan = None if limit is None else planned_torques(result)
    if limit is None or plan is None:
        return []
    share = plan.peak / limit
    worst = int(share.argmax())
    name = result.arm.joint_names[worst]
    note = f"{name}: {plan.peak[worst]:.4g} of {limit[worst]:.4g} N m, planned"
    return [
        Tile(
            label="drive torque / limit",
            value=_ratio(float(share[worst])),
            note=note + _rests(result),
        )
    ]


def _experiment(result: RunResult) -> list[Tile]:
    """Tile of the error of an experiment; empty without an experiment."""
    label = "experiment: contour error, RMS"
    if result.failure is not None:
        return [Tile(label=label, value="failed", note="see below")]
    if result.experiment is None:
        return []
    e = result.experiment.evaluation.contour_error
    note = f"largest {e.max * 1e3:.4f} mm, on rigid bodies{_rests(result)}"
    return [Tile(label=label, value=f"{e.rms * 1e3:.4f} mm", note=note)]


def _rests(result: RunResult) -> str:
    """Reference to the assumed masses, if any are assumed."""
    return "; masses: see below" if assumed_numbers(result.arm) else ""


def _ratio(value: float) -> str:
    """A ratio as text."""
    return f"{value:.3f}" if value < 10 else f"{value:.4g}"
