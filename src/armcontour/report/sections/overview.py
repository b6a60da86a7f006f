"""The first section: every run in a few figures."""

from __future__ import annotations

from armcontour.report.section import Section, Tile
from armcontour.study import RunResult, Study
from armcontour.study.quantities import assumed, planned_torques


def overview(study: Study) -> Section:
    """How long, how exact, how hard: one row of figures a run."""
    return Section(
        key="overview",
        title="At a glance",
        text=(
            "Contour error is the distance from the tool to the path it was to follow, as executed "
            "on the simulated servo with its acceleration limit."
        ),
        tiles=tuple((name, _tiles(result)) for name, result in study.runs.items()),
    )


def _tiles(result: RunResult) -> tuple[Tile, ...]:
    e = result.evaluation
    worst = int(e.demand_ratio.argmax())
    share = ", ".join(f"{x:.0%}" for x in e.saturated)
    tiles = [
        Tile(label="motion", value=f"{e.duration:.3f} s", note=f"at rest after {e.settled:.3f} s"),
        Tile(
            label="contour error, RMS",
            value=f"{e.contour_error.rms * 1e3:.4f} mm",
            note=f"over {e.until:.2f} s",
        ),
        Tile(
            label="contour error, largest",
            value=f"{e.contour_error.max * 1e3:.4f} mm",
            note=f"at {e.contour_error.t_max:.2f} s, s = {e.contour_error.s_max:.3f} m",
        ),
        Tile(
            label="joint demand / limit",
            value=_ratio(float(e.demand_ratio[worst])),
            note=f"joint {worst + 1}; saturated {share} of the time",
        ),
    ]
    tiles.append(
        Tile(
            label="joints fully used",
            value=f"{e.utilisation:.0%}",
            note="of the motion: some joint within 1 % of a limit",
        )
    )
    if e.speed_ratio == e.speed_ratio:
        tiles.append(
            Tile(
                label="tool speed / assigned",
                value=_ratio(e.speed_ratio),
                note=f"largest {e.speed * 1e3:.1f} mm/s, mean {e.path_velocity * 1e3:.1f} mm/s",
            )
        )
    tiles += _torque(result)
    if result.experiment is not None:
        e = result.experiment.evaluation
        tiles.append(
            Tile(
                label="experiment: contour error, RMS",
                value=f"{e.contour_error.rms * 1e3:.4f} mm",
                note=f"largest {e.contour_error.max * 1e3:.4f} mm, on rigid bodies{_rests(result)}",
            )
        )
    return tuple(tiles)


def _torque(result: RunResult) -> list[Tile]:
    """The largest share of a drive's torque that the plan takes, where both are known."""
    limit, plan = result.run.limits.joint_torque, planned_torques(result)
    if limit is None or plan is None:
        return []
    share = plan.peak / limit
    worst = int(share.argmax())
    note = f"joint {worst + 1}: {plan.peak[worst]:.4g} of {limit[worst]:.4g} N m, planned"
    return [
        Tile(
            label="drive torque / limit",
            value=_ratio(float(share[worst])),
            note=note + _rests(result),
        )
    ]


def _rests(result: RunResult) -> str:
    return "; masses: see Drive torques" if assumed(result.execution.arm) else ""


def _ratio(value: float) -> str:
    return f"{value:.4f}" if value < 10 else f"{value:.4g}"
