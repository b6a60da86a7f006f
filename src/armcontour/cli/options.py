"""Groups of command line options: dataclasses whose fields become options."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path as FilePath
from typing import Annotated, Any, TypeAlias, get_origin, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from armcontour.core.errors import InvalidInput
from armcontour.core.text import describe_fields

# Options that set job keys, by name; `python -m tests.cli.test_options` writes the file.
SHORT: dict[str, dict[str, Any]] = {
    x["option"].split("/")[0].strip("-").replace("-", "_"): x
    for x in json.loads(FilePath(__file__).with_name("job_options.json").read_text("utf-8"))
}
KINDS = {"text": str, "texts": list[str], "flag": bool, "number": float, "whole": int}
DRAWING = ("Drawing", "G-code")
POSITION, SPEED = "Cell and position of the drawing", "Speed, corners and start"
FILES, POINTS = "Files for robot controllers", "Points of these files"
LOGS, CONTROLLER = "Log and files of numbers", "Robot controller"
# Panels of the help, by option; other options are in the panel "Options".
PANELS = {
    **{name: row["topic"] for name, row in SHORT.items()},
    "cell": POSITION,
    "sets": SPEED,
    **dict.fromkeys(("log", "set_points", "start", "end", "columns", "interpolation"), LOGS),
    **dict.fromkeys(("on", "address", "hal", "drives", "execute", "speed_factor"), CONTROLLER),
    **dict.fromkeys(("runs", "reserve", "band"), CONTROLLER),
    "arm": "Arm",
    "workers": "Processes",
    **dict.fromkeys(("out", "force", "open_page", "as_json"), "Results"),
}


def _write_panels(self: Any, ctx: Any, formatter: Any) -> None:
    """Write arguments, options and commands of a help text in panels."""
    # Typer itself writes panels only with the library `rich`, which doubles the time of the help,
    # truncates long options in narrow terminals and removes units in square brackets as markup.
    panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
    for x in self.get_params(ctx):
        if (record := x.get_help_record(ctx)) is not None:
            panel = "Options" if isinstance(x, TyperOption) else "Arguments"
            panels.setdefault(PANELS.get(x.name, panel), []).append(record)
    for name, called in getattr(self, "commands", {}).items():
        row = f"{name:<8}", called.get_short_help_str(200)
        panels.setdefault(called.rich_help_panel, []).append(row)
    for title, rows in panels.items():
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)


class CommandGroup(TyperGroup):
    """Group of commands whose help has panels."""

    format_options = _write_panels


class Command(TyperCommand):
    """Command whose help has panels, and that refuses repeated options."""

    format_options = _write_panels

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; refuse an option with one value that is specified several times."""
        *_, parameters = self.make_parser(ctx).parse_args(list(args))
        for x in parameters:
            single = isinstance(x, TyperOption) and not (x.multiple or x.is_flag)
            if single and (times := parameters.count(x)) > 1:
                name = max(x.opts, key=len)
                raise InvalidInput(f"{name} has one value, but is specified {times} times.")
        return super().parse_args(ctx, args)


def grouped(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a command so that the fields of its dataclass parameters become options."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: options_of(x) for name, x in hints.items() if is_dataclass(x)}

    @wraps(command)
    def call(**options: Any) -> Any:
        for name, group in groups.items():
            values = {x: options.pop(x) for x in group}
            keys = {x: values.pop(x) for x in SHORT if x in values}
            options[name] = hints[name](**values, **({"keys": keys} if keys else {}))
        return command(**options)

    declared: dict[str, tuple[Any, Any]] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        declared |= groups.get(name, {name: (hints[name], parameter.default)})
    call.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(x, inspect.Parameter.KEYWORD_ONLY, annotation=hint, default=default)
            for x, (hint, default) in declared.items()
        ]
    )
    return call


def options_of(group: Any) -> dict[str, tuple[Any, Any]]:
    """Annotation for typer and default of each option of a dataclass, by name."""
    texts, hints = describe_fields(group), get_type_hints(group, include_extras=True)
    options: dict[str, tuple[Any, Any]] = {}
    for x in fields(group):
        hint, default = hints[x.name], inspect.signature(group).parameters[x.name].default
        if x.name != "keys":
            option = typer.Option(f"--{x.name.replace('_', '-')}")
            if get_origin(hint) is Annotated:
                hint, option = hint.__origin__, copy(hint.__metadata__[0])
            option.help = option.help or texts[x.name]
            options[x.name] = Annotated[hint, option], default
            continue
        for name, row in SHORT.items():
            if row["topic"] in hint.__metadata__:
                kind = KINDS[row["kind"]]
                option = typer.Option(row["option"], help=row["help"], min=row["least"])
                options[name] = Annotated[kind | None, option], None
    return options


Set: TypeAlias = dict[str, Any]
Text: TypeAlias = str | None
Texts: TypeAlias = list[str] | None
File: TypeAlias = FilePath | None
JobOrDrawing = Annotated[
    FilePath,
    typer.Argument(
        help="Job file (.yaml); or a drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), or "
        "waypoints (.csv), with --cell.",
    ),
]
Out = Annotated[FilePath, typer.Option("--out", "-o", help="Folder for the results.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")]
ForceFile = Annotated[bool, typer.Option("--force", help="Replace a file of that name.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Name = Annotated[str | None, typer.Option("--run", help="Run of the job.")]


@dataclass(frozen=True, kw_only=True)
class CellOptions:
    """Options for the cell of a drawing.

    Args:
        cell: Cell for a drawing: a built-in cell (fr3, panda, pmk3s, ur10e, ur5e), or a job file
            without a path.
    """

    cell: Text = None


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Options for processes.

    Args:
        workers: Number of processes on this machine; by default one per processor. 0 uses only this
            process.
    """

    workers: Annotated[int | None, typer.Option("--workers", min=0, max=1000)] = None


@dataclass(frozen=True, kw_only=True)
class ResultOptions:
    """Options for a run of a job and its result.

    Args:
        out: Folder for the results; by default none is written.
    """

    run_name: Name = None
    out: Annotated[File, typer.Option("--out", "-o")] = None
    force: Force = False
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of the command `run`.

    Args:
        simulate: Simulate the servo, and write a report of it.
        changes: Plan changes of each run, and report those that save most time or turn a violated
            run into a valid one; by default for jobs of up to 50 segments in all runs.
    """

    simulate: Annotated[bool, typer.Option("--simulate/--no-simulation")] = True
    changes: Annotated[bool | None, typer.Option("--changes/--no-changes")] = None
    force: Force = False


@dataclass(frozen=True, kw_only=True)
class DrawingOptions:
    """Options for reading a drawing."""

    keys: Annotated[Set, *DRAWING]


@dataclass(frozen=True, kw_only=True)
class JobOptions(CellOptions):
    """Options that replace values of a job, and that place a drawing.

    Args:
        sets: Any key of the job with its value, as in limits.speed='0.2 m/s' or
            runs.fast.timing.reserve=2%; may be repeated.
    """

    keys: Annotated[Set, *DRAWING, POSITION, SPEED]
    sets: Annotated[Texts, typer.Option("--set")] = None


@dataclass(frozen=True, kw_only=True)
class StudioOptions(CellOptions):
    """Options of the command `studio`.

    Args:
        open_page: Open the page in a browser.
        port: Port on this machine; 0 for any.
    """

    open_page: Annotated[bool, typer.Option("--open/--no-open")] = True
    port: Annotated[int, typer.Option("--port", min=0, max=65535)] = 0


@dataclass(frozen=True, kw_only=True)
class LogOptions:
    """Options for reading a log.

    Args:
        columns: Names of the columns of a CSV file without a header: 't [ms],q1 [deg],-,q2'; or new
            names of columns or joints: 'q# [deg]=axis_#'.
    """

    columns: Text = None


@dataclass(frozen=True, kw_only=True)
class WindowOptions(LogOptions):
    """Options for reading a part of a log.

    Args:
        start: First time of the log to use, such as '2 s'.
        end: Last time of the log to use, such as '30 s'.
    """

    start: Annotated[Text, typer.Option("--from")] = None
    end: Annotated[Text, typer.Option("--to")] = None


@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Options for exports of every run."""

    keys: Annotated[Set, FILES, POINTS]


@dataclass(frozen=True, kw_only=True)
class StoredExportOptions:
    """Options of the command `export`.

    Args:
        run_name: Run of the result.
        reference: Export the plan, without compensation for the servo.
        format: Format of the file: csv, ros-yaml, urscript, kuka, abb, or a .j2 file; by default
            determined by its extension.
    """

    keys: Annotated[Set, POINTS]
    run_name: Annotated[Text, typer.Option("--run")] = None
    reference: bool = False
    format: Text = None
    force: ForceFile = False


@dataclass(frozen=True, kw_only=True)
class CheckOptions(LogOptions):
    """Options of the command `check`.

    Args:
        arm: Built-in arm, an arm file (.yaml, .urdf), or a job file or cell with the arm; by
            default the job's.
        limits: Limits file (YAML); by default the limits of the job, or of the arm.
        path: Job file (YAML) with the required path of the tool.
        run_name: Run of that job, if its runs differ in corners.
        scene: Cell: check the clearance of the arm from it and from itself. A built-in cell such as
            ur5e, or a job file, of which only the scene is required.
        noise: Largest error of measured positions and, optionally, of velocities: '0.05 mrad, 2
            mrad/s'.
        controller: Also check the commands that a controller sends for these points: jtc,
            jtc_spline, jtc_none, linuxcnc or hold.
        rate: Rate of that controller: '500 Hz'.
    """

    arm: Text = None
    limits: File = None
    path: File = None
    run_name: Annotated[Text, typer.Option("--run")] = None
    scene: Text = None
    noise: Text = None
    controller: Text = None
    rate: Text = None
    as_json: AsJson = False


@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """Options for a robot controller.

    Args:
        address: Address of a robot (franka, ur).
        hal: HAL file of the machine (linuxcnc); by default joints are simulated.
        drives: File with the key servo, such as a servo.yaml, for the simulated joints (linuxcnc);
            by default the plant of the job. A dead time of one cycle is LinuxCNC's default loop.
        execute: Move the robot, after its name is typed on the terminal.
    """

    address: Text = None
    hal: File = None
    drives: File = None
    execute: bool = False


@dataclass(frozen=True, kw_only=True)
class IdentifyOptions(ControllerOptions, WindowOptions, ResultOptions):
    """Options of the command `identify`.

    Args:
        on: Controller that executes the motions of the identification: linuxcnc, franka or ur. The
            argument is then the job.
        reserve: With --on, minimum reserve of this run.
        sets: With --on, any key of the job with its value; may be repeated.
        arm: Arm with whose tool the errors are also reported: as for check.
        drive_cycle: Cycle of the drives' loops; by default continuous.
        model: Model of the servo: auto, second or first.
        interpolation: Command between set-points: linear or step; by default determined from
            the log.
        validate: Log that is used only to validate the model; may be repeated.
    """

    on: Text = None
    reserve: str = "20 %"
    sets: Annotated[Texts, typer.Option("--set")] = None
    arm: Text = None
    drive_cycle: Text = None
    model: str = "auto"
    interpolation: Text = None
    validate: list[FilePath] | None = None


@dataclass(frozen=True, kw_only=True)
class CertifyOptions(ResultOptions):
    """Options of the command `certify`."""

    keys: Annotated[Set, "Certificate"]


@dataclass(frozen=True, kw_only=True)
class PlaceOptions(WorkerOptions):
    """Options of the command `place`.

    Args:
        x: Displacements along x of the path, and their number: '-300 mm .. 300 mm, 25'.
        y: Displacements along y.
        z: Displacements along z.
        yaw: Rotations about z: '0 deg .. 360 deg, 8'.
        move: Moved object: part, about the middle of its path; or base, about its origin.
    """

    x: Text = None
    y: Text = None
    z: Text = None
    yaw: Text = None
    move: str = "part"
    run_name: Name = None
    force: Force = False


@dataclass(frozen=True, kw_only=True)
class LearnOptions(ControllerOptions, WindowOptions, ResultOptions):
    """Options of the command `learn`.

    Args:
        on: Controller on which the runs are played: linuxcnc, franka or ur. Earlier runs in the
            folder of --out are continued.
        runs: With --on, number of runs.
        reserve: With --on, minimum reserve of the plan, because corrections need acceleration.
        band: With --on, largest deviation of a joint from the plan before a motion is stopped, such
            as '5 mrad'; by default 3 times the largest one of the best run, in the first run as
            for play.
        set_points: Executed set-points: set_points.csv of run or of the previous learn, or the
            folder of that result.
        log: Log of that run: CSV of positions over time.
        out: Folder for set-points of the next run, and a report.
    """

    on: Text = None
    runs: Annotated[int, typer.Option("--runs", min=1)] = 4
    reserve: str = "20 %"
    band: Text = None
    set_points: File = None
    log: File = None


@dataclass(frozen=True, kw_only=True)
class PlayOptions(ControllerOptions, ResultOptions):
    """Options of the command `play`.

    Args:
        on: Controller: linuxcnc, franka or ur. The adapter for ur has never run on a robot.
        speed_factor: Share of the job's speed.
        band: Largest difference of a joint from its simulated position before the motion is
            stopped, such as '5 mrad'; by default 2 mrad and the distance that it moves in 50 ms at
            its largest speed.
        set_points: Learned set-points: set_points.csv of learn, or its folder; with
            --speed-factor '100 %'.
        out: Folder for the log.
    """

    on: str
    speed_factor: str = "10 %"
    band: Text = None
    set_points: File = None


@dataclass(frozen=True, kw_only=True)
class BatchOptions(WorkerOptions):
    """Options of the command `batch`.

    Args:
        over: A key of the job with its values, as in limits.speed='[50 mm/s, 0.1 m/s]'; with
            several keys, all combinations are run.
    """

    over: Annotated[list[str], typer.Option("--over")]
