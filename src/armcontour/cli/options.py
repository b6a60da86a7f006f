"""Groups of command-line options: dataclasses whose fields are options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path as FilePath
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

# Topics in the help of a command, with the names of their options; others stand under "Options".
TOPICS = {
    "Drawing": ("units", "scale", "layer", "contour", "color", "flat", "texts", "skip_unknown",
                "waypoint_columns"),
    "G-code": ("skip", "tool", "only_tool"),
    "Cell and position of the drawing": ("cell", "at", "turn", "ignore_collisions"),
    "Speed, corners and start": ("speed", "tolerance", "corner_shape", "line_tolerance", "zone",
                                 "iterations", "continuity", "from_s"),
    "Log and files of numbers": ("log", "taught", "tool_positions", "start", "end", "columns",
                                 "topic", "unwrap", "interpolation"),
    "Places": ("over", "objective", "uncertainty", "move", "absolute", "about",
               "every", "refined"),
    "Arm": ("arm", "tip", "base", "joint_limits", "package", "xacro_arg", "trust_xacro"),
    "Files for robot controllers": ("export", "template", "output", "period", "derivatives",
                                    "tool_motion", "call"),
    "Processes": ("workers", "cluster"),
    "Results": ("out", "force", "open_report", "open_page", "as_json"),
}  # fmt: skip
# Words for types that typer names as Python does.
WORDS = {"str": "text", "int": "number", "float": "number", "path": "file"}
_TYPE = re.compile(r"<(?:list\[)?(str|int|float|path)\]?(?: range)?>", re.IGNORECASE)


class Command(TyperCommand):
    """A command whose help lists the options by topic."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write a section for the arguments, for the options without a topic, and per topic."""
        topics = {name: topic for topic, names in TOPICS.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {
            x: [] for x in ("Arguments", "Options", *TOPICS)
        }
        order = list(topics)
        for x in sorted(
            self.get_params(ctx), key=lambda x: order.index(x.name) if x.name in topics else -1
        ):
            record = x.get_help_record(ctx)
            if record is not None:
                form = _TYPE.sub(lambda found: f"<{WORDS[found[1].lower()]}>", record[0])
                topic = topics.get(x.name or "", "Options")
                if x.param_type_name == "argument":
                    name, _, kind = form.partition(" ")
                    topic, form = "Arguments", f"{name.upper()} {kind}".strip()
                sections[topic].append((form, record[1]))
        _write_sections(sections, formatter)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Arguments in capitals, without the braces that some versions of typer add."""
        pieces = super().collect_usage_pieces(ctx)
        return [x.replace("...}...", "...").strip("{}").upper() for x in pieces]


class Commands(TyperGroup):
    """A group of commands whose help lists them by topic, which is their `rich_help_panel`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section per topic."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for name, x in self.commands.items():
            rows = sections.setdefault(getattr(x, "rich_help_panel", None) or "Commands", [])
            rows.append((f"{name:<8}", x.get_short_help_str(200)))
        _write_sections(sections, formatter)


def _write_sections(sections: dict[str, list[tuple[str, str]]], formatter: Any) -> None:
    """Write the sections that have rows into a help text."""
    for title, rows in sections.items():
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)


def grouped(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a command so that the fields of its dataclass parameters become options.

    Args:
        command: A function whose parameters, or the fields of its dataclass parameters, have
            annotations of typer.
    """
    hints = get_type_hints(command, include_extras=True)
    groups = {k: x for k, x in hints.items() if isinstance(x, type) and is_dataclass(x)}

    @wraps(command)
    def call(**options: Any) -> Any:
        for name, of in groups.items():
            options[name] = of(**{x.name: options.pop(x.name) for x in fields(of)})
        return command(**options)

    found: list[inspect.Parameter] = []
    for x in inspect.signature(command).parameters.values():
        of = groups.get(x.name)
        known = hints if of is None else get_type_hints(of, include_extras=True)
        found += [
            y.replace(annotation=known[y.name], kind=inspect.Parameter.KEYWORD_ONLY)
            for y in ([x] if of is None else inspect.signature(of).parameters.values())
        ]
    call.__annotations__ = {x.name: x.annotation for x in found}
    call.__signature__ = inspect.Signature(found)  # type: ignore[attr-defined]
    return call


Out = Annotated[FilePath, typer.Option("--out", "-o", help="Folder for the results.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result in that folder.")]
ForceFile = Annotated[bool, typer.Option("--force", help="Replace a file of that name.")]
CellOfDrawing = Annotated[
    str | None,
    typer.Option(
        "--cell",
        help="Where a drawing is run: a built-in cell (fr3, panda, pmk3s, ur10e, ur5e), or a job "
        "file without a path.",
    ),
]
Open = Annotated[bool, typer.Option("--open", help="Open the report in a browser.")]
TrustXacro = Annotated[
    bool,
    typer.Option(
        "--trust-xacro",
        help="Load an arm from a .xacro file: such a file is a program that can run anything.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Columns = Annotated[
    str | None,
    typer.Option(
        "--columns",
        help="Names of the columns of CSV without a first line for them: 't [ms],q1 [deg],-,q2'; "
        "or new names of columns or joints: 'q# [deg]=axis_#'.",
    ),
]
Topic = Annotated[
    str | None, typer.Option("--topic", help="Topic of a bag of ROS, if several would do.")
]
Start = Annotated[
    str | None, typer.Option("--from", help="First time of the log to use, such as '2 s'.")
]
End = Annotated[
    str | None, typer.Option("--to", help="Last time of the log to use, such as '30 s'.")
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=0,
        max=1000,
        help="Processes on this machine; by default one a processor. 0 works in this one.",
    ),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster", help="Address of a Dask scheduler that does the work: tcp://10.0.0.1:8786."
    ),
]
Unwrap = Annotated[bool, typer.Option("--unwrap", help="Undo jumps of whole turns in the log.")]
Name = Annotated[str | None, typer.Option("--run", help="Run of the job.")]
ServoBudget = Annotated[
    str | None,
    typer.Option("--servo", help="Contour error of the execution, such as '2 um'; else the job's."),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options of the command `run`."""

    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate/--no-simulation", help="Simulate the servo, and write a report of it."
        ),
    ] = True
    force: Force = False
    open_report: Open = False


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingOptions:
    """Options for reading a drawing."""

    units: Annotated[
        str | None, typer.Option("--units", help="Unit of the drawing, such as mm.")
    ] = None
    scale: Annotated[
        float | None, typer.Option("--scale", help="Factor of all lengths of the drawing.")
    ] = None
    layer: Annotated[
        list[str] | None, typer.Option("--layer", help="Only this layer; may be repeated.")
    ] = None
    contour: Annotated[
        list[str] | None, typer.Option("--contour", help="Only this contour; may be repeated.")
    ] = None
    color: Annotated[
        list[str] | None,
        typer.Option(
            "--color",
            help="Only this colour of DXF or of strokes in SVG: a name, '#rrggbb', or a number of "
            "AutoCAD; may be repeated.",
        ),
    ] = None
    flat: Annotated[bool, typer.Option("--flat", help="Leave z out.")] = False
    texts: Annotated[
        str | None,
        typer.Option("--texts", help="TEXT of DXF: leave_out, or contours of its letters."),
    ] = None
    skip_unknown: Annotated[bool, typer.Option("--skip-unknown", help="Skip unknown elements.")] = (
        False
    )
    waypoint_columns: Annotated[
        str | None,
        typer.Option(
            "--waypoint-columns",
            help="Names of the columns of a CSV of waypoints without a line for them: "
            "'x [mm],y [mm],-'.",
        ),
    ] = None
    skip: Annotated[
        list[str] | None,
        typer.Option("--skip", help="Leave out these words of G-code, such as 'T,M6'."),
    ] = None
    tool: Annotated[
        list[str] | None,
        typer.Option("--tool", help="Number and diameter of a tool, for G41 and G42: '1: 3 mm'."),
    ] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JobOptions(DrawingOptions):
    """Options that replace values of a job, and that place a drawing."""

    cell: CellOfDrawing = None
    at: Annotated[
        str | None,
        typer.Option("--at", help="Origin of the drawing, such as '300 mm, 0 mm, 100 mm'."),
    ] = None
    turn: Annotated[
        str | None, typer.Option("--turn", help="Roll, pitch, yaw of the drawing: '0, 0, 90 deg'.")
    ] = None
    speed: Annotated[
        str | None, typer.Option("--speed", help="Assigned velocity, such as '50 mm/s'.")
    ] = None
    tolerance: Annotated[
        str | None, typer.Option("--tolerance", help="Corner error, such as '0.2 mm'.")
    ] = None
    corner_shape: Annotated[
        str | None,
        typer.Option(
            "--corner-shape",
            help="Shape of corners: arc, or free for the fastest path within the tolerance; for "
            "runs with the timing optimal.",
        ),
    ] = None
    line_tolerance: Annotated[
        str | None,
        typer.Option(
            "--line-tolerance", help="For the shape free: tolerance outside --zone, '0.1 mm'."
        ),
    ] = None
    zone: Annotated[
        str | None,
        typer.Option("--zone", help="For the shape free: distance around corners, '20 mm'."),
    ] = None
    iterations: Annotated[
        int | None,
        typer.Option(
            "--iterations", min=0, help="For the shape free: most steps of the search, such as 10."
        ),
    ] = None
    continuity: Annotated[
        str | None,
        typer.Option(
            "--continuity",
            help="Of rounded corners: tangent, as arcs have it, or curvature, with which the tool "
            "goes on where jerk is limited (the default there).",
        ),
    ] = None
    only_tool: Annotated[
        str | None,
        typer.Option("--only-tool", help="Only the contours of this tool of a job's tools: T2."),
    ] = None
    from_s: Annotated[
        str | None,
        typer.Option("--from-s", help="Resume at this arc length of all contours: '1.25 m'."),
    ] = None
    ignore_collisions: Annotated[
        bool,
        typer.Option(
            "--ignore-collisions",
            help="Go on where the arm comes too near to itself or to its cell; results say so.",
        ),
    ] = False
    trust_xacro: TrustXacro = False


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOptions:
    """Options of the command `studio`."""

    cell: CellOfDrawing = None
    open_page: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser.")
    ] = True
    port: Annotated[
        int, typer.Option("--port", min=0, max=65535, help="Port on this machine; 0 for any.")
    ] = 0
    exit_when_closed: Annotated[
        bool,
        typer.Option("--exit-when-closed", help="End a minute after the last page is closed."),
    ] = False
    trust_xacro: TrustXacro = False


Output = Annotated[
    list[str] | None,
    typer.Option(
        "--output",
        help="Output of an event or an analog output in exports: tool=0, power=AO0, or for one "
        "format abb:tool=doTool.",
    ),
]
Period = Annotated[
    str | None,
    typer.Option("--period", help="Time between points of an exported plan, such as '48 ms'."),
]
Derivatives = Annotated[
    int,
    typer.Option(
        "--derivatives",
        min=0,
        max=2,
        help="Highest derivative in exports: 2 for accelerations, 1 for velocities, or 0.",
    ),
]
Call = Annotated[
    bool,
    typer.Option(
        "--call",
        help="With urscript: call the program at the end of its file, for a pendant's script file.",
    ),
]
ToolMotion = Annotated[
    bool,
    typer.Option(
        "--tool-motion",
        help="Write point, orientation and speed of the tool, as commanded, into exports too.",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Options for exports of every run."""

    export: Annotated[
        list[str] | None,
        typer.Option(
            "--export",
            help="Format of taught data: csv, npz, ros-yaml, mcap, urscript; may be repeated.",
        ),
    ] = None
    template: Annotated[
        list[str] | None,
        typer.Option("--template", help="Export by a template: kuka, abb, or a .j2 file."),
    ] = None
    output: Output = None
    period: Period = None
    derivatives: Derivatives = 2
    tool_motion: ToolMotion = False
    call: Call = False


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredExportOptions:
    """Options of the command `export`."""

    run_name: Annotated[str | None, typer.Option("--run", help="Run of the result.")] = None
    reference: Annotated[
        bool,
        typer.Option("--reference", help="Export the plan, without compensation for the servo."),
    ] = False
    format: Annotated[
        str | None,
        typer.Option("--format", help="Format of the file; by default that of its ending."),
    ] = None
    template: Annotated[
        str | None, typer.Option("--template", help="A template: kuka, abb, or a .j2 file.")
    ] = None
    output: Output = None
    period: Period = None
    derivatives: Derivatives = 2
    tool_motion: ToolMotion = False
    call: Call = False
    job: Annotated[
        FilePath | None,
        typer.Option(
            "--job", help="Job file or cell whose arm gives tool points: job.yaml, or ur5e."
        ),
    ] = None
    trust_xacro: TrustXacro = False
    force: ForceFile = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions:
    """Options of an arm from a robot description."""

    tip: Annotated[
        str | None, typer.Option("--tip", help="Link at the end of an arm from .urdf or .xacro.")
    ] = None
    base: Annotated[
        str | None, typer.Option("--base", help="Fixed link at the base of such an arm.")
    ] = None
    joint_limits: Annotated[
        FilePath | None,
        typer.Option("--joint-limits", help="A joint_limits.yaml of MoveIt for that arm."),
    ] = None
    package: Annotated[
        list[str] | None,
        typer.Option(
            "--package", help="Folder of a ROS package of a .xacro: NAME=FOLDER; may be repeated."
        ),
    ] = None
    xacro_arg: Annotated[
        list[str] | None,
        typer.Option("--xacro-arg", help="Argument of a .xacro: NAME=VALUE; may be repeated."),
    ] = None
    trust_xacro: TrustXacro = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions(ArmOptions):
    """Options of the command `check`."""

    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            help="Built-in arm, or an arm file (.yaml, .urdf; .xacro with --trust-xacro); by "
            "default the job's.",
        ),
    ] = None
    limits: Annotated[
        FilePath | None,
        typer.Option("--limits", help="Limits file (YAML); else the job's, or the arm's own."),
    ] = None
    path: Annotated[
        FilePath | None,
        typer.Option("--path", help="Job file (YAML) with the required path of the tool."),
    ] = None
    run_name: Annotated[
        str | None, typer.Option("--run", help="Run of that job, if its runs differ in corners.")
    ] = None
    scene: Annotated[
        str | None,
        typer.Option(
            "--scene",
            help="Cell: check how near the arm comes to it and to itself. A built-in cell such as "
            "ur5e, a job file, of which scene is enough, or obstacles as URDF.",
        ),
    ] = None
    columns: Columns = None
    topic: Topic = None
    noise: Annotated[
        str | None,
        typer.Option(
            "--noise",
            help="Largest error of measured positions, and perhaps of velocities: "
            "'0.05 mrad, 2 mrad/s'.",
        ),
    ] = None
    as_json: AsJson = False


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions(ArmOptions):
    """Options of the command `identify`."""

    arm: Annotated[
        str | None,
        typer.Option(
            "--arm",
            help="Nominal arm: with masses, payload, friction and drive inertias are identified "
            "too; without, errors are also at the tool. Built in, or an arm file (.yaml, .urdf; "
            ".xacro with --trust-xacro).",
        ),
    ] = None
    servo: Annotated[
        FilePath | None,
        typer.Option("--servo", help="Nominal servo of that arm: a job file, or a servo.yaml."),
    ] = None
    gravity: Annotated[
        str | None,
        typer.Option(
            "--gravity",
            help="What the controller of that arm adds against gravity: nominal, loaded or none; "
            "by default what the logs speak for.",
        ),
    ] = None
    drive_cycle: Annotated[
        str | None,
        typer.Option(
            "--drive-cycle",
            help="Cycle of the drives' loops; by default continuous, with --arm 0.25 ms.",
        ),
    ] = None

    out: Annotated[
        FilePath | None,
        typer.Option("--out", "-o", help="Folder for servo file, robot file, report; else none."),
    ] = None
    model: Annotated[
        str, typer.Option("--model", help="Model of the servo: auto, second or first.")
    ] = "auto"
    interpolation: Annotated[
        str | None,
        typer.Option(
            "--interpolation",
            help="Command between set-points: linear or step; by default as the log says.",
        ),
    ] = None
    start: Start = None
    end: End = None
    longest_dead_time: Annotated[
        str, typer.Option("--longest-dead-time", help="Longest dead time in the search.")
    ] = "250 ms"
    predict: Annotated[
        list[FilePath] | None,
        typer.Option("--predict", help="Log to predict, which is not used otherwise; repeatable."),
    ] = None
    columns: Columns = None
    topic: Topic = None
    unwrap: Unwrap = False
    force: Force = False
    open_report: Open = False
    as_json: AsJson = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CertifyOptions:
    """Options of the command `certify`."""

    run_name: Name = None
    total_tolerance: Annotated[
        str | None,
        typer.Option(
            "--total-tolerance",
            help="Tolerance of rounding and execution together, such as '1 mm'; else the job's.",
        ),
    ] = None
    servo: ServoBudget = None
    plant: Annotated[
        str | None,
        typer.Option("--plant", help="Robots to certify for: servo, rigid_body; else the job's."),
    ] = None
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=0,
            max=1000,
            help="Processes on this machine that execute robots of a box as rigid bodies; by "
            "default one a processor. 0 works in this one.",
        ),
    ] = None
    cluster: Cluster = None
    out: Annotated[
        FilePath | None, typer.Option("--out", "-o", help="Folder for the certificate; else none.")
    ] = None
    force: Force = False
    open_report: Open = False
    as_json: AsJson = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceOptions:
    """Options of the command `place`; None is as the job's key `placement` has it."""

    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            help="Axis, range and number of places: 'x: -300 mm .. 300 mm, 25'; also y, z, yaw and "
            "tilt, in the coordinates of the path; may be repeated. The job's key placement may "
            "hold this and the other choices; options replace its keys, one by one.",
        ),
    ] = None
    objective: Annotated[
        str | None,
        typer.Option(
            "--objective",
            help="What is best: cycle (default), manipulability, clearance or torque (the margin).",
        ),
    ] = None
    uncertainty: Annotated[
        list[str] | None,
        typer.Option(
            "--uncertainty",
            help="Position error of the part: 'x: 2 mm'; the worst corner counts; may be "
            "repeated; 0 takes an axis out that the job has.",
        ),
    ] = None
    move: Annotated[
        str | None,
        typer.Option("--move", help="What is moved: the part (default), or the base of the arm."),
    ] = None
    absolute: Annotated[
        bool | None,
        typer.Option(
            "--absolute/--relative",
            help="Values of x, y and z are coordinates, or distances from here (default).",
        ),
    ] = None
    about: Annotated[
        str | None,
        typer.Option(
            "--about",
            help="Point that is placed and turned about: middle of the path (default), origin of "
            "its coordinates, or '400 mm, 0 mm, 0 mm'.",
        ),
    ] = None
    every: Annotated[
        bool | None,
        typer.Option(
            "--every/--no-every", help="Plan every place, for a map without bounds; slow."
        ),
    ] = None
    refined: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Look for a better place between those of the grid, too (default).",
        ),
    ] = None
    workers: Annotated[
        int | None,
        typer.Option(
            "--workers",
            min=0,
            max=1000,
            help="Processes on this machine; by default one a processor for 100 places or more. 0 "
            "works in this one.",
        ),
    ] = None
    cluster: Cluster = None
    run_name: Name = None
    force: Force = False
    open_report: Open = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnOptions:
    """Options of the command `learn`."""

    run_name: Name = None
    taught: Annotated[
        FilePath | None,
        typer.Option(
            "--taught",
            help="What the robot executed: taught.csv of run or of the learn before, or the folder "
            "of that result.",
        ),
    ] = None
    log: Annotated[
        FilePath | None,
        typer.Option("--log", help="Log of that run: CSV of positions over time, or a bag."),
    ] = None
    tool_positions: Annotated[
        FilePath | None,
        typer.Option(
            "--tool-positions",
            help="CSV of measured positions of the tool over the same time: t, x, y, z.",
        ),
    ] = None
    judge_only: Annotated[
        bool,
        typer.Option(
            "--judge-only",
            help="Say what the robot did by its log, the contour error, and learn nothing. Without "
            "--taught it executed the set-points of the job.",
        ),
    ] = False
    out: Annotated[
        FilePath | None,
        typer.Option("--out", "-o", help="Folder for taught data of the next run, and a report."),
    ] = None
    start: Start = None
    end: End = None
    columns: Columns = None
    topic: Topic = None
    unwrap: Unwrap = False
    force: Force = False
    open_report: Open = False
    as_json: AsJson = False


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchOptions:
    """Options of the command `batch`."""

    workers: Workers = None
    cluster: Cluster = None
    retry: Annotated[bool, typer.Option("--retry", help="Try jobs again that failed.")] = False
    trust_xacro: TrustXacro = False
    open_report: Open = False
    as_json: Annotated[
        bool, typer.Option("--json", help="Print progress and the end as lines of JSON.")
    ] = False
