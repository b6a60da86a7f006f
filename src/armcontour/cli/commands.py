"""The commands of `armcontour`, and their help."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from copy import copy
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from armcontour._version import __version__
from armcontour.cli.options import (
    AsJson,
    BatchOptions,
    CertifyOptions,
    CheckOptions,
    Command,
    CommandGroup,
    DrawingOptions,
    ExportOptions,
    Force,
    IdentifyOptions,
    JobOptions,
    LearnOptions,
    Out,
    PlaceOptions,
    PlayOptions,
    RunOptions,
    StoredExportOptions,
    StudioOptions,
    grouped,
)

if TYPE_CHECKING:
    from armcontour.core.progress import Progress
    from armcontour.jobs import Job

JobOrDrawing = Annotated[
    FilePath,
    typer.Argument(
        help="Job file (.yaml); or a drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), or "
        "waypoints (.csv), with --cell.",
    ),
]
PACKAGE = FilePath(__file__).parents[1]
# Topics under which the help lists the commands.
RUN, PREPARE, JUDGE = "Plan and run", "Look, place, prepare", "Check and certify"
ROBOT, INSTALLED = "With the robot", "About this installation"


app = typer.Typer(
    name="armcontour",
    help="Contouring with industrial robot arms: as fast as the limits allow, within the error.",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=(
        "Exit codes: 0 done; 1 not kept, not determined, or refused by the system; 2 invalid "
        "input; 3 out of reach; 4 no timing or certificate; 5 delay not compensated; 6 simulation "
        "not completed; 7 cannot tell; 8 collision; 9 provisional; 10 robot differs; "
        "11 robot lost; 130, 141 and 143 interrupted. "
        "Example: armcontour run gasket.dxf --cell ur5e --out gasket"
    ),
    cls=CommandGroup,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def app_for(arguments: Sequence[str]) -> typer.Typer:
    """Program with only the called command, because creating all commands takes time.

    Args:
        arguments: Arguments of the program. If the first is not a command, all commands are
            created.
    """
    called = [
        x for x in app.registered_commands if x.callback and x.callback.__name__ in arguments[:1]
    ]
    only = copy(app)
    only.registered_commands = called or app.registered_commands
    return only


def _command(
    topic: str, example: str, name: str | None = None
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator that registers a command, with its topic and an example in the help."""
    epilog = f"\b\nExample:\n  armcontour {example}"
    register = app.command(name, cls=Command, rich_help_panel=topic, epilog=epilog)
    return lambda command: register(grouped(command))


def _version(value: bool) -> None:
    """Print the version and exit."""
    if value:
        typer.echo(f"armcontour {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", "-V", help="Print the version.", callback=_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Options of the program."""
    pass


@_command(RUN, "run gasket.dxf --cell ur5e --out gasket --export urscript")
def run(
    job: JobOrDrawing,
    out: Out,
    options: RunOptions,
    job_options: JobOptions,
    exports: ExportOptions,
) -> None:
    """Run a job or a drawing: writes summary.json, report.html, and trajectories (CSV).

    Exit codes: 0 done, 1 done but no run is kept; others as for errors.
    """
    from armcontour.cli.exports import refuse_unused
    from armcontour.cli.inputs import open_job
    from armcontour.cli.run_command import run_job

    def read(progress: Progress) -> Job:
        opened = open_job(job, job_options, progress, exports)
        refuse_unused(exports.keys, opened)
        return opened

    code = run_job(
        read,
        out,
        force=options.force,
        simulate=options.simulate,
        changes=options.changes,
    )
    raise typer.Exit(code)


@_command(RUN, "demo")
def demo(out: Out = FilePath("demo"), force: Force = False) -> None:
    """Run two built-in jobs: the paper's job on the PMK-3s, and a plate that a UR5e cuts."""
    from armcontour.cli.run_command import run_demo

    run_demo(out, force=force)


@_command(RUN, "studio gasket.dxf --cell ur5e")
def studio(
    options: StudioOptions,
    job: Annotated[
        FilePath | None,
        typer.Argument(
            help="Job file (.yaml), or a drawing, G-code or waypoints with --cell; by default the "
            "start page."
        ),
    ] = None,
) -> None:
    """Open a web page on which you edit the path and see the resulting robot motion at once."""
    from armcontour.cli.studio_command import open_studio

    open_studio(job, options)


@_command(PREPARE, "show gasket.dxf --layer CUT")
def show(
    drawing: Annotated[
        FilePath,
        typer.Argument(
            help="Drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), or waypoints (.csv)."
        ),
    ],
    drawing_options: DrawingOptions,
    as_json: AsJson = False,
) -> None:
    """Show size and layers of a drawing; no arm is required."""
    from armcontour.cli.show_command import show_file

    show_file(drawing, drawing_options, as_json)


@_command(JUDGE, "check motion.csv --arm ur5e --noise '0.05 mrad'")
def check(
    trajectory: Annotated[
        FilePath, typer.Argument(help="Time-stamped joint trajectory: CSV, or YAML of ROS.")
    ],
    options: CheckOptions,
) -> None:
    """Check a joint trajectory against limits.

    Exit codes: 0 all limits kept, 1 a limit violated, 7 the samples cannot tell, 2 invalid input.
    """
    from armcontour.cli.check_command import check_file

    raise typer.Exit(check_file(trajectory, options))


@_command(JUDGE, "certify job.yaml --total-tolerance '1 mm' --out certificate")
def certify(
    job: JobOrDrawing,
    job_options: JobOptions,
    options: CertifyOptions,
) -> None:
    """Find the fastest plan whose execution stays within a tolerance; exit code 4 without one."""
    from armcontour.cli.certify_command import certify_file

    raise typer.Exit(certify_file(job, job_options, options))


@_command(PREPARE, "place gasket.dxf --cell ur5e --x '-300 mm .. 300 mm, 25' --out place")
def place(
    job: JobOrDrawing,
    out: Out,
    job_options: JobOptions,
    options: PlaceOptions,
) -> None:
    """Plan a job at every place of a grid of its part: writes a map, a table, and the best job.

    Exit codes: 0 done, 1 done but no place is feasible; others as for errors.
    """
    from armcontour.cli.study_commands import place_file

    raise typer.Exit(place_file(job, out, job_options, options))


@_command(RUN, "batch job.yaml --over 'corners.tolerance=[0.1 mm, 1 mm]' --out results")
def batch(
    job: JobOrDrawing,
    out: Annotated[
        FilePath,
        typer.Option(
            "--out", "-o", help="Folder for the results; an earlier batch in it is continued."
        ),
    ],
    options: BatchOptions,
    job_options: JobOptions,
) -> None:
    """Run a job for all combinations of values of its keys; an interrupted batch can be continued.

    Exit codes: 0 every job is done or refused; 1 some jobs failed; 2 no job is valid.
    """
    from armcontour.cli.study_commands import batch_file

    raise typer.Exit(batch_file(job, out, job_options, options))


@_command(ROBOT, "export gasket gasket.script")
def export(
    result: Annotated[
        FilePath, typer.Argument(help="Folder of a result, of `run`, `certify` or `learn`.")
    ],
    file: Annotated[
        FilePath, typer.Argument(help="File to write; its extension determines the format.")
    ],
    options: StoredExportOptions,
) -> None:
    """Export the set-points or the plan of an earlier result for a robot controller."""
    from armcontour.cli.exports import export_stored

    export_stored(result, file, options)


@_command(ROBOT, "identify shake.csv --out servo")
def identify(
    logs: Annotated[
        list[FilePath],
        typer.Argument(
            metavar="LOG...",
            help="Log of time, command and measured: CSV; several are joined. With --on, a job.",
        ),
    ],
    options: IdentifyOptions,
) -> None:
    """Identify servos from logs; with --on, from new motions.

    Exit codes: 0 good, 1 a joint or the compensation is doubtful, 9 good for one program only.
    """
    from armcontour.cli.identify_command import identify_files

    raise typer.Exit(identify_files(logs, options))


@_command(ROBOT, "learn job.yaml --set-points result --log robot.csv --out next")
def learn(
    job: JobOrDrawing,
    options: LearnOptions,
    job_options: JobOptions,
) -> None:
    """Learn the set-points of the next run from logs; with --on, from runs on the robot."""
    if options.on is not None:
        from armcontour.cli.robot_commands import learn_robot

        raise typer.Exit(learn_robot(job, job_options, options))
    from armcontour.cli.learn_command import learn_file

    learn_file(job, job_options, options)


@_command(ROBOT, "play job.yaml --on linuxcnc --speed-factor '50 %' --execute --out played")
def play(job: JobOrDrawing, options: PlayOptions, job_options: JobOptions) -> None:
    """Play a run on a robot controller and record it; the robot moves only with --execute."""
    from armcontour.cli.play_command import play_file

    raise typer.Exit(play_file(job, job_options, options))


@_command(PREPARE, "arms")
def arms() -> None:
    """List the built-in arms with their sources and assumed parameters."""
    from armcontour.cli.console import print_lines
    from armcontour.files.robots.loading import arm_names, load_arm

    for name in arm_names():
        arm = load_arm(name)
        chain = arm.chain
        heavy = chain is not None and chain.masses is not None
        masses = "known" if heavy else "not known"
        print_lines(f"{name}: {arm.name}, {arm.dof} joints, masses {masses}")
        print_lines(f"    source: {arm.source}")
        if chain is not None and chain.assumed:
            print_lines(f"    assumed: {chain.assumed}")


@_command(PREPARE, "init ur5e --out cell.yaml")
def init(
    cell: Annotated[
        str, typer.Argument(help="Built-in cell, by the name of its arm: see `armcontour arms`.")
    ] = "ur5e",
    out: Annotated[
        FilePath | None,
        typer.Option("--out", "-o", help="File for the cell (.yaml); by default CELL.yaml."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file of that name.")] = False,
) -> None:
    """Write a built-in cell as a job file to edit, with arm, limits, servo and comments."""
    from armcontour.cli.console import print_lines
    from armcontour.core import staging
    from armcontour.core.errors import InvalidInput
    from armcontour.files.cell import YAML, cell_text

    text = cell_text(cell)
    file = FilePath(f"{cell}.yaml") if out is None else out
    if file.suffix.lower() not in YAML:
        raise InvalidInput(f"The file of --out must have the extension {YAML[0]}, but is {file}.")
    if file.exists() and not force:
        raise InvalidInput(
            f"{file} already exists. Specify another file with --out, or add --force to replace it."
        )
    try:
        staging.write_atomically(file, lambda x: x.write_text(text, encoding="utf-8"))
    except OSError as error:
        raise staging.unwritable(file, error) from None
    print_lines(
        f"{file} is a copy of the cell {cell}. Set its arm, its servo and the position of the "
        f"drawing. Then use: armcontour run DRAWING --cell {file} --out FOLDER"
    )


@_command(INSTALLED, "compile usual", name="compile")
def compile_functions(
    kind: Annotated[
        Literal["all", "usual", "plane", "space"],
        typer.Argument(
            help="Functions to compile: all, or those of usual runs in the plane, in space, or "
            "both (usual)."
        ),
    ] = "all",
) -> None:
    """Compile functions now that are otherwise compiled at first use, to avoid later waiting."""
    from armcontour.cli.console import print_lines
    from armcontour.cli.progress_bars import show_progress
    from armcontour.core.compilation import compile_kernels

    with show_progress() as progress:
        compiled = compile_kernels(kind, progress)
    print_lines(
        f"{compiled.functions} functions are compiled, {compiled.compiled} of them now. They are "
        f"stored in {compiled.folder}."
    )
    if not os.environ.get("NUMBA_CACHE_DIR") and PACKAGE not in compiled.folder.parents:
        print_lines(
            f"Note: only your own programs use these files, because the folder {PACKAGE} is not "
            "writable. Other users compile their own files. To share the files, set "
            "NUMBA_CACHE_DIR to a folder that all users can write to, now and whenever armcontour "
            "runs."
        )


@_command(INSTALLED, "schema")
def schema() -> None:
    """Print the JSON Schema of job files."""
    import json

    from armcontour.files import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))
