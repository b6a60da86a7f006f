"""The command `certify`: certify a job, print and write the certificate."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour._progress import under
from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.certification import Budget, Certificate
    from armcontour.cli.options import CertifyOptions, JobOptions
    from armcontour.evaluation import Evaluation
    from armcontour.jobs import Goal


CONTOURS = (
    "contour",
    "start [s]",
    "motion [s]",
    "cost [s]",
    "error [mm]",
    "allowed [mm]",
    "left [mm]",
)


def certify_file(file: FilePath, job_options: JobOptions, x: CertifyOptions) -> None:
    """Certify a job, print the certificate, and write it with its taught data.

    Args:
        file: A job file, or a drawing.

        job_options: Options that replace values of the job.
        x: Options of the command; the folder gets summary.json, report.html and trajectories.

    Raises:
        ArmContourError: An invalid job, or no plan that meets the goal; then nothing is written.
    """
    from armcontour._pool import open_executor
    from armcontour.cli.opening import open_job
    from armcontour.cli.progress import search_progress
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder, certificate_json

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    shared = x.workers is not None or x.cluster is not None
    with (
        open_executor(x.workers, x.cluster) if shared else nullcontext() as executor,
        nullcontext() if x.out is None else ResultFolder(x.out, force=x.force) as folder,
    ):
        from armcontour.certification import certify
        from armcontour.certification.certifying import goal_of

        with search_progress("certifying") as progress:
            job = open_job(file, job_options, under(progress, "reading"), x)
            if shared:
                _refuse_nothing_shared(goal_of(job))
            found = certify(job, x.run_name, executor=executor, progress=progress)
        if folder is not None:
            _write(found, folder)
    if x.as_json:
        print(certificate_json(found), end="")
    else:
        _print(found, None if x.out is None else x.out / "report.html")
    if x.open_report and x.out is not None:
        open_page(x.out / "report.html")


def _refuse_nothing_shared(goal: Goal) -> None:
    """Refuse `--workers` and `--cluster` for a certificate that has no work for them.

    Raises:
        InvalidInput: No robots of a box are executed as rigid bodies.
    """
    from armcontour.errors import InvalidInput

    if goal.plant != "rigid_body" or goal.box is None:
        raise InvalidInput(
            "--workers and --cluster share robots of a box that are executed as rigid bodies, and "
            "this certificate executes none: leave them out, or give the job's certificate a box "
            "and plant: rigid_body."
        )


def _write(found: Certificate, folder: Any) -> None:
    """Write the plan, its taught data, the derating, the report and the summary."""
    from armcontour.cli.running import write_motions
    from armcontour.io import certificate_json, derating_csv
    from armcontour.report import render_report

    write_motions(folder, found.job, found.study.runs)
    folder.write("derating.csv", derating_csv(found))
    folder.write("report.html", render_report(found.study, certificate=found))
    folder.write("summary.json", certificate_json(found, [*folder.files, "summary.json"]))


def _print(found: Certificate, report: FilePath | None) -> None:
    """Print the certificate, and a table of its contours if there are several."""
    console = Console()
    title = f"Certified: {found.job.title}, run {found.run.name}"
    console.show_table(["", ""], certified_rows(found), title=title)
    if len(found.contours) > 1:
        console.show_table(CONTOURS, contour_rows(found), title="Contours")
    for lowered in found.lowered:
        console.say(f"Reduced: {lowered}.")
    console.say(f"Holds for: {found.model}.")
    if found.clearance is not None:
        near = found.clearance
        console.say(near.sentence if near.kept else f"Warning: {near.sentence}")
        if near.below_base is not None:
            console.say(f"Warning: {near.below_base}")
    if found.on_bodies is not None:
        console.say(found.on_bodies)
    if found.condition:
        console.say(found.condition)
    for note in found.job.arm.notes:
        console.say(f"Note: {note}")
    if report is not None:
        console.say(f"Report: {report.resolve().as_uri()}")


def certified_rows(found: Certificate) -> list[tuple[str, str]]:
    """Names and values of a certificate; errors are those of the contour with the least margin."""
    budget, e, worst = found.budget, found.evaluation, found.worst
    rows = [
        ("motion", f"{found.duration:.4f} s"),
        ("at rest after", f"{e.settled:.4f} s"),
        ("uncertified optimum", f"{found.uncertified.duration:.4f} s"),
    ]
    if len(found.contours) > 1:
        rows.append(("contours", f"{len(found.contours)}, all certified"))
        rows.append(("least left on", worst.name))
    if found.shapes:
        rows.append(("corners", _shapes(found)))
    rows += [
        ("rounding", f"{budget.rounding * 1e3:.5f} mm"),
        ("servo", f"{budget.servo * 1e3:.5f} mm"),
        ("command interval", f"{budget.sampling * 1e3:.5f} mm"),
    ]
    if found.corners is not None:
        rows.append(("worst robot of the box", f"{budget.box * 1e3:.5f} mm"))
    if budget.unexplained:
        rows.append(("not explained by the servo model", f"{budget.unexplained * 1e3:.5f} mm"))
    rows += _linear_rows(found)
    rows += [
        ("left", f"{budget.left * 1e3:.5f} mm"),
        ("contour error, RMS", f"{e.contour_error.rms * 1e3:.5f} mm"),
        ("path missed, largest", f"{e.missed.max * 1e3:.5f} mm"),
        *_assigned(e),
        ("acceleration derated, mean", ", ".join(f"{x:.2%}" for x in found.headroom)),
        *_demand(found),
        ("saturated", ", ".join(f"{x:.1%}" for x in e.saturated)),
    ]
    if found.pauses > 0:
        rows.append(("pauses after rapids", f"{found.pauses:.4f} s"))
    if found.experiment is not None:
        rows.append(("experiment, largest", _largest(found.experiment.evaluation)))
    return rows


def _shapes(found: Certificate) -> str:
    """The shape of the corners, and what the other shape takes at least."""
    shape = found.run.rounding.shape if found.run.rounding else ""
    others = [f"{name} at least {t:.4f} s" for name, t in found.shapes.items() if name != shape]
    return ", ".join([shape, *others])


def _linear_rows(found: Certificate) -> list[tuple[str, str]]:
    """What the linear model of rigid bodies says, and which part of it each unknown takes."""
    linear, corners, drawn = found.linear, found.corners, found.spread
    if linear is None or corners is None or drawn is None:
        return []
    parts = ", ".join(f"{kind} {x * 1e3:.4f}" for kind, x in linear.shares.items())
    return [
        ("executed by MuJoCo", f"{len(corners)} corners, {len(drawn)} drawn robots"),
        ("linear model, all of the box", f"{linear.bound * 1e3:.5f} mm"),
        ("of it by", f"{parts} mm"),
        ("its worst robot", linear.corner),
    ]


def _demand(found: Certificate) -> list[tuple[str, str]]:
    """What the drives need of their limits: acceleration of servos, torque over a box of bodies."""
    if found.linear is None:
        return [("demand / limit", f"{found.evaluation.demand_ratio.max():.6f}")]
    spreads = [x for x in (found.corners, found.spread) if x is not None]
    most = max([float(x.demand_ratio.max()) for x in spreads], default=None)
    return [] if most is None else [("torque / limit, of the box", f"{most:.6f}")]


def _assigned(e: Evaluation) -> list[tuple[str, str]]:
    """The tool speed over what is assigned; empty where nothing is."""
    return [("tool speed / assigned", f"{e.speed_ratio:.6f}")] if e.speed_ratio > 0 else []


def contour_rows(found: Certificate) -> list[tuple[str, ...]]:
    """Rows for the contours of a certificate, and a row for the whole program."""
    rows = [
        (
            x.name,
            f"{x.t[0]:.3f}",
            f"{x.duration:.4f}",
            f"{x.duration - x.optimum:+.4f}",
            *_errors(x.budget),
        )
        for x in found.contours
    ]
    whole = ("whole program", "0.000", f"{found.duration:.4f}", f"{found.cost:+.4f}")
    return [*rows, (*whole, *_errors(found.budget))]


def _errors(budget: Budget) -> tuple[str, str, str]:
    """Executed error, allowed error and margin of a contour [mm], as text."""
    return (
        f"{budget.executed * 1e3:.5f}",
        f"{budget.servo_allowed * 1e3:.5g}",
        f"{budget.left * 1e3:.5f}",
    )


def _largest(e: Evaluation) -> str:
    """Largest contour error of an evaluation, as text."""
    return f"{e.contour_error.max * 1e3:.5f} mm"
