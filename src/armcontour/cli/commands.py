"""The commands of `armcontour`, and their help."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated

import typer

from armcontour._version import __version__

app = typer.Typer(
    name="armcontour",
    help="Contouring with industrial robot arms: as fast as the limits allow, within the error.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Out = Annotated[FilePath, typer.Option("--out", help="Folder for the results.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")]
Memory = Annotated[
    str | None, typer.Option("--memory", help="What the program may take, such as '4 GB'.")
]
Open = Annotated[bool, typer.Option("--open", help="Open the report in a browser.")]
TrustXacro = Annotated[
    bool,
    typer.Option(
        "--trust-xacro",
        help="Load an arm from a .xacro file: such a file is a program that can run anything.",
    ),
]


def _version(value: bool) -> None:
    if value:
        typer.echo(f"armcontour {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    pass


@app.command()
def run(
    job: Annotated[
        FilePath,
        typer.Argument(
            help="Job file (.yaml); or a drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), or "
            "waypoints (.csv, .parquet), with --cell."
        ),
    ],
    out: Out,
    cell: Annotated[
        str | None,
        typer.Option(
            "--cell", help="Where a drawing is run: pmk3s, ur5e, or a job file without a path."
        ),
    ] = None,
    units: Annotated[
        str | None, typer.Option("--units", help="Unit of the drawing, such as mm.")
    ] = None,
    scale: Annotated[
        float | None, typer.Option("--scale", help="Factor of all lengths of the drawing.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option("--at", help="Origin of the drawing, such as '300 mm, 0 mm, 100 mm'."),
    ] = None,
    turn: Annotated[
        str | None, typer.Option("--turn", help="Roll, pitch, yaw of the drawing: '0, 0, 90 deg'.")
    ] = None,
    layer: Annotated[
        list[str] | None, typer.Option("--layer", help="Only this layer; may be repeated.")
    ] = None,
    contour: Annotated[
        list[str] | None, typer.Option("--contour", help="Only this contour; may be repeated.")
    ] = None,
    flat: Annotated[bool, typer.Option("--flat", help="Leave z out.")] = False,
    skip_unknown: Annotated[
        bool, typer.Option("--skip-unknown", help="Skip what the reader does not know.")
    ] = False,
    skip: Annotated[
        list[str] | None,
        typer.Option("--skip", help="Leave out these words of G-code, such as 'T,M6'."),
    ] = None,
    speed: Annotated[
        str | None, typer.Option("--speed", help="Assigned velocity, such as '50 mm/s'.")
    ] = None,
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", help="Corner error, such as '0.2 mm'.")
    ] = None,
    from_s: Annotated[
        str | None,
        typer.Option("--from-s", help="Resume where the contours are so long: '1.25 m'."),
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            help="Format of taught data: csv, parquet, npz, ros-yaml, mcap, urscript; may be "
            "repeated.",
        ),
    ] = None,
    template: Annotated[
        list[str] | None,
        typer.Option("--template", help="Export by a template: kuka, abb, or a .j2 file."),
    ] = None,
    output: Annotated[
        list[str] | None,
        typer.Option("--output", help="Digital output of an event in exports: tool=0."),
    ] = None,
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate/--no-simulation", help="Simulate the servo, and write a report of it."
        ),
    ] = True,
    memory: Memory = None,
    force: Force = False,
    open_report: Open = False,
    trust_xacro: TrustXacro = False,
) -> None:
    """Run a job or a drawing: writes summary.json, report.html, and trajectories (CSV)."""
    from armcontour.cli.exporting import exports_of
    from armcontour.cli.opening import Overrides, open_job
    from armcontour.cli.running import run_job

    overrides = Overrides(
        units=units,
        scale=scale,
        at=at,
        turn=turn,
        layers=layer,
        names=contour,
        flat=flat,
        skip=skip_unknown,
        skip_words=skip,
        speed=speed,
        tolerance=tolerance,
        from_s=from_s,
        memory=memory,
    )
    run_job(
        lambda told: open_job(job, cell, overrides, told, trust_xacro=trust_xacro),
        out,
        force=force,
        open_report=open_report,
        exports=exports_of(export or [], template or [], output or []),
        simulate=simulate,
    )


@app.command()
def demo(out: Out = FilePath("demo"), force: Force = False, open_report: Open = False) -> None:
    """Run the built-in job: the paper's contouring job on the PMK-3s."""
    from armcontour.cli.running import built_in_job, run_job

    run_job(lambda told: built_in_job(), out, force=force, open_report=open_report)


@app.command()
def check(
    trajectory: Annotated[FilePath, typer.Argument(help="Time-stamped joint trajectory (CSV).")],
    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            help="Built-in arm, or an arm file (.yaml, .urdf; .xacro with --trust-xacro); by "
            "default the job's.",
        ),
    ] = None,
    limits: Annotated[
        FilePath | None,
        typer.Option("--limits", help="Limits file (YAML); else the job's, or the arm's own."),
    ] = None,
    path: Annotated[
        FilePath | None,
        typer.Option("--path", help="Job file (YAML) whose path the tool was to follow."),
    ] = None,
    run_name: Annotated[
        str | None, typer.Option("--run", help="Run of that job, if its runs differ in corners.")
    ] = None,
    tip: Annotated[
        str | None, typer.Option("--tip", help="Link at the end of an arm from .urdf or .xacro.")
    ] = None,
    base: Annotated[
        str | None, typer.Option("--base", help="Fixed link at the base of such an arm.")
    ] = None,
    joint_limits: Annotated[
        FilePath | None,
        typer.Option("--joint-limits", help="A joint_limits.yaml of MoveIt for that arm."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    trust_xacro: TrustXacro = False,
) -> None:
    """Judge any joint trajectory against limits.

    Exit codes: 0 every limit is kept, 1 one is violated, 7 the samples cannot tell, 2 an input
    cannot be used.
    """
    from armcontour.cli.checking import check_file

    code = check_file(
        trajectory,
        arm,
        limits,
        path,
        run_name=run_name,
        tip=tip,
        base=base,
        joint_limits=joint_limits,
        as_json=as_json,
        trust_xacro=trust_xacro,
    )
    raise typer.Exit(code)


Name = Annotated[str | None, typer.Option("--run", help="Run of the job.")]


@app.command()
def certify(
    job: Annotated[FilePath, typer.Argument(help="Job file (YAML).")],
    run_name: Name = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            "--total-tolerance",
            help="Tolerance of rounding and execution together, such as '1 mm'; else the job's.",
        ),
    ] = None,
    servo: Annotated[
        str | None,
        typer.Option(
            "--servo", help="Contour error of the execution, such as '2 um'; else the job's."
        ),
    ] = None,
    out: Annotated[
        FilePath | None, typer.Option("--out", help="Folder for the certificate; else none.")
    ] = None,
    force: Force = False,
    open_report: Open = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
    memory: Memory = None,
    trust_xacro: TrustXacro = False,
) -> None:
    """Find the fastest plan whose execution holds a tolerance; exit code 4 if there is none."""
    from armcontour.cli.certifying import certify_file

    certify_file(
        job,
        run_name,
        out,
        tolerance=tolerance,
        servo=servo,
        force=force,
        open_report=open_report,
        as_json=as_json,
        memory=memory,
        trust_xacro=trust_xacro,
    )


@app.command()
def sweep(
    job: Annotated[FilePath, typer.Argument(help="Job file (YAML).")],
    out: Out,
    run_name: Name = None,
    tolerances: Annotated[
        str | None, typer.Option("--tolerances", help="Such as '1 mm, 2 mm, 5 mm'.")
    ] = None,
    speeds: Annotated[
        str | None, typer.Option("--speeds", help="Such as '0.1 m/s, 0.2 m/s'.")
    ] = None,
    memory: Memory = None,
    force: Force = False,
    open_report: Open = False,
    trust_xacro: TrustXacro = False,
) -> None:
    """Plot certified times against corner tolerance and against assigned velocity."""
    from armcontour.cli.sweeping import sweep_file

    sweep_file(
        job,
        run_name,
        out,
        tolerances=tolerances,
        speeds=speeds,
        memory=memory,
        force=force,
        open_report=open_report,
        trust_xacro=trust_xacro,
    )


@app.command()
def identify(
    log: Annotated[FilePath, typer.Argument(help="Log of time, command and measured (CSV).")],
    out: Annotated[
        FilePath | None, typer.Option("--out", help="Folder for servo file and report; else none.")
    ] = None,
    model: Annotated[
        str, typer.Option("--model", help="Model of the servo: auto, second or first.")
    ] = "auto",
    interpolation: Annotated[
        str | None,
        typer.Option(
            "--interpolation",
            help="Command between set-points: linear or step; by default as the log says.",
        ),
    ] = None,
    start: Annotated[float | None, typer.Option("--from", help="First time to use [s].")] = None,
    end: Annotated[float | None, typer.Option("--to", help="Last time to use [s].")] = None,
    longest_dead_time: Annotated[
        float, typer.Option("--longest-dead-time", help="Dead times are looked for up to this [s].")
    ] = 0.25,
    unwrap: Annotated[
        bool, typer.Option("--unwrap", help="Undo jumps of whole turns in the log.")
    ] = False,
    force: Force = False,
    open_report: Open = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Tell a servo's gains and dead time from a log; exit code 1 if it leaves one open."""
    from armcontour.cli.identifying import identify_file

    determined = identify_file(
        log,
        out,
        model=model,
        interpolation=interpolation,
        start=start,
        end=end,
        longest_dead_time=longest_dead_time,
        unwrap=unwrap,
        force=force,
        open_report=open_report,
        as_json=as_json,
    )
    raise typer.Exit(0 if determined else 1)


@app.command()
def arms() -> None:
    """List the built-in arms, with what is assumed of them."""
    from armcontour.cli.listing import listed_arms

    for line in listed_arms():
        typer.echo(line)


@app.command()
def schema() -> None:
    """Print the JSON Schema of job files."""
    import json

    from armcontour.io import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))
