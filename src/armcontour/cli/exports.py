"""Export of set-points and plans of a run or of a stored result, with the command line options."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.inputs import read_option
from armcontour.core.file_access import MEGABYTE
from armcontour.core.text import count_noun, digits

if TYPE_CHECKING:
    from armcontour.cli.options import ExportOptions, PointOptions, StoredExportOptions
    from armcontour.files import ResultFolder
    from armcontour.files.exports.formats import ExportFormat
    from armcontour.files.exports.table import SetPointTable
    from armcontour.jobs import Job, RunResult
    from armcontour.motion import SetPoints, Trajectory
    from armcontour.program import Event
    from armcontour.robot import Arm

# Labels of exported set-points, and of the exported plan (without compensation).
SET_POINTS, REFERENCE = "set_points", "reference"
# Formats whose controllers interpolate set-points with quintics, and ratio of the acceleration to
# its limit above which a warning is given.
JOINED_BY_QUINTICS = ("ros-yaml", "mcap")
MAX_ACCELERATION_RATIO = 3.0

Outputs = dict[str, int | str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Format and file name extension of an exported file."""

    format: ExportFormat  # Format with its options and the outputs of events
    ending: str  # File name extension
    option: str  # Command line option or file name that requests this file, for messages

    @property
    def plans(self) -> bool:
        """True if the controller plans the motion between points; such files have no set-points."""
        from armcontour.files.exports.template import templates

        return self.format.label in templates()


@dataclass(frozen=True, slots=True, kw_only=True)
class Exports:
    """Formats and options with which every run is exported."""

    targets: tuple[Target, ...] = ()
    cycle: float | None = None  # Time between points of the plan [s]; None: cycle of the run
    derivatives: int | None = None  # Highest derivative of the positions in files
    tool_motion: bool = False  # True if files have point, orientation and speed of the tool
    effort: bool = False  # True if files have the joint torques of the plan
    # Ratio of the tolerances in ros-yaml files to the predicted errors; None: no tolerances.
    tolerances: float | None = None

    def __bool__(self) -> bool:
        return bool(self.targets)

    def write(self, target: Target, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file; without analog outputs if the format does not support them."""
        from armcontour.core.errors import error_context
        from armcontour.files.exports.formats import WITH_ANALOG

        if not isinstance(target.format, WITH_ANALOG):
            table = dataclasses.replace(table, analog={})
        with error_context(target.option):
            target.format.write(table, file)

    def cycle_of(self, target: Target) -> float | None:
        """Time between points of the plan in a file [s]; None: cycle of the run."""
        return None if target.format.kind == "urscript" else self.cycle

    def describe(self, target: Target, parts: Sequence[SetPointTable]) -> list[str]:
        """Sentences about exported files: events without outputs, number of digits, and size."""
        return target.format.describe(parts, lambda event, output: f"--output {event}={output}")

    def table_options(self, arm: Arm) -> dict[str, Any]:
        """Keyword arguments for tables; they include the arm only if a file has tool positions."""
        needed = (self.tool_motion or self.effort) or any(
            x.format.kind in ("npz", "template") for x in self.targets
        )
        return {
            "arm": arm if needed else None,
            "joint_names": arm.joint_names,
            "derivatives": self.derivatives,
            "tool_motion": self.tool_motion,
            "effort": self.effort,
        }

    def with_tolerances(self, target: Target, label: str, result: RunResult) -> Target:
        """Target with tolerances from simulated errors, if it is ros-yaml and gets set-points."""
        from armcontour.files.exports.ros import predict_tolerances

        if target.format.kind != "ros-yaml" or self.tolerances is None or label != SET_POINTS:
            return target
        if result.execution is None:
            return target
        tolerances = predict_tolerances(result.execution, self.tolerances)
        format = dataclasses.replace(target.format, tolerances=tolerances)  # type: ignore[call-arg]
        return dataclasses.replace(target, format=format)


def exports_of(command: ExportOptions) -> Exports:
    """Read the export options of a command."""
    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import Interval
    from armcontour.files.exports.formats import TemplateFormat, format_named
    from armcontour.files.exports.template import ending_of

    kinds = [format_named(name) for name in command.export or ()]
    if TemplateFormat in kinds:
        raise InvalidInput(
            "--export template does not specify a template. Use --template NAME instead."
        )
    targets = [
        Target(format=kind(), ending=kind.ending, option=f"--export {kind.kind}") for kind in kinds
    ]
    for name in command.template or ():
        format, option = TemplateFormat(template=name), f"--template {name}"
        targets.append(Target(format=format, ending=ending_of(name), option=option))
    cycle = read_option("--cycle", command.cycle, Interval)
    if not targets:
        options = {
            "--cycle": cycle is not None,
            "--derivatives": command.derivatives is not None,
            "--tool-motion": command.tool_motion,
            "--effort": command.effort,
            "--decimals": command.decimals is not None,
            "--comments": command.comments,
            "--points-per-file": command.points_per_file is not None,
            "--tolerances": command.tolerances is not None,
            "--call": command.call,
        }
        for option, is_set in options.items():
            if is_set:
                raise InvalidInput(f"{option} requires --export or --template.")
    _refuse_same_files(targets)
    if command.tolerances is not None and command.tolerances < 1:
        raise InvalidInput(f"--tolerances must be at least 1, but is {command.tolerances:g}.")
    return Exports(
        targets=tuple(_with_options(targets, command)),
        cycle=cycle,
        derivatives=command.derivatives,
        tool_motion=command.tool_motion,
        effort=command.effort,
        tolerances=command.tolerances,
    )


def _with_options(targets: Sequence[Target], command: PointOptions) -> list[Target]:
    """Targets with the options that their formats support."""
    from armcontour.core.errors import InvalidInput, error_context
    from armcontour.files.exports.file_parts import read_points_per_file

    text = command.points_per_file
    points = int(text) if text is not None and text.isdecimal() else text
    with error_context("--points-per-file"):
        read_points_per_file(points)
    options: dict[str, Any] = {
        "points_per_file": points,
        "decimals": command.decimals,
        "comments": command.comments or None,
        "call": command.call or None,
    }
    chosen = {key: value for key, value in options.items() if value is not None}
    unused = set(chosen)
    complete = []
    for target in _with_outputs(targets, command.output or []):
        taken = {key: x for key, x in chosen.items() if hasattr(target.format, key)}
        unused -= set(taken)
        complete.append(
            dataclasses.replace(target, format=dataclasses.replace(target.format, **taken))
        )
    if unused and targets:
        option = f"--{min(unused).replace('_', '-')}"
        raise InvalidInput(f"None of the exported formats supports {option}. Remove the option.")
    return complete


def _with_outputs(targets: Sequence[Target], texts: Sequence[str]) -> list[Target]:
    """Targets with the outputs of events, from texts such as "tool=0" or "abb:tool=doTool"."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files.exports.formats import FORMATS, WITH_OUTPUTS
    from armcontour.files.exports.template import templates

    takers = [x.format.label for x in targets if isinstance(x.format, WITH_OUTPUTS)]
    if texts and not takers:
        raise InvalidInput("--output requires the format urscript or a template.")
    # Outputs by format, then by event; the key "" means all formats.
    outputs: dict[str, Outputs] = {}
    for text in texts:
        event, equals, number = text.partition("=")
        kind, colon, remainder = event.partition(":")
        if colon and kind in takers:
            event = remainder
        elif colon and kind in (*FORMATS, *templates()):
            raise InvalidInput(
                f"--output {text} is for the format {kind}, which is not exported. Remove this "
                f"option, or export {kind} too."
            )
        else:
            kind = ""
        if not (event and equals and number):
            raise InvalidInput(
                f"The value of --output must be an event and its output, such as tool=0, but is "
                f"{text!r}."
            )
        events = outputs.setdefault(kind, {})
        if event in events:
            raise InvalidInput(
                f"--output specifies two outputs for the event {event!r}. Specify only one."
            )
        events[event] = int(number) if number.isdecimal() else number
    complete = []
    for target in targets:
        format = target.format
        if isinstance(format, WITH_OUTPUTS):
            merged = outputs.get("", {}) | outputs.get(format.label, {})
            format = dataclasses.replace(format, outputs=merged)
        complete.append(dataclasses.replace(target, format=format))
    return complete


def _refuse_same_files(targets: list[Target]) -> None:
    """Raise InvalidInput if two exports would be written to the same file."""
    from armcontour.core.errors import InvalidInput

    taken: dict[str, str] = {}
    for target in targets:
        if taken.get(target.ending) == target.option:
            raise InvalidInput(f"{target.option} is specified twice. Specify it only once.")
        if target.ending in taken:
            raise InvalidInput(
                f"{taken[target.ending]} and {target.option} would both be written to "
                f"{SET_POINTS}{target.ending}. Remove one of them, or use a template with another "
                "extension, such as cell.txt.j2."
            )
        taken[target.ending] = target.option


def rehearse(job: Job, exports: Exports, scratch: FilePath) -> None:
    """Write a table of two points in each format, to find errors of options before the run."""
    from armcontour.core.errors import InvalidInput

    events = _events_of(job)
    _refuse_outputs(
        exports, {*(event.name for event in events), *job.process.analog_names}, "the job"
    )
    intervals = [run.cycle for run in job.runs]
    cycles = intervals if exports.cycle is None else [*intervals, exports.cycle]
    for number, cycle in enumerate(dict.fromkeys(cycles)):
        table = _two_points(job, cycle, events, exports)
        for target in exports.targets:
            if cycle not in (*intervals, exports.cycle_of(target)):
                continue
            # Each file has its own name, because a bag is a folder, and folders are not replaced.
            file = scratch / f"rehearsal{number}{target.ending}"
            try:
                exports.write(target, table, file)
            except OSError as error:
                raise InvalidInput(
                    f"A test file for {target.option} cannot be written: {error.strerror}."
                ) from None


def _refuse_outputs(exports: Exports, events: Iterable[str], owner: str) -> None:
    """Raise InvalidInput if an output is specified for an event that does not exist."""
    from armcontour.files.exports.formats import check_outputs, outputs_of

    names = {name: 0 for target in exports.targets for name in outputs_of(target.format)}
    check_outputs(names, events, option="--output", owner=owner)


def _events_of(job: Job) -> list[Event]:
    """Events of a job; each combination of name and value occurs once."""
    from armcontour.program import Contour, Event

    events: list[Event] = []
    for variant in job.process.variants:
        events += variant.events
        if variant.switch is not None:
            events += [
                Event(name=variant.switch.name, value=x) for x in (variant.switch.value, False)
            ]
    for move in job.program.moves:
        if isinstance(move, Event):
            events.append(move)
        elif isinstance(move, Contour):
            events += move.events
    return list({(x.name, type(x.value), x.value): x for x in events}.values())


def _two_points(job: Job, cycle: float, events: Sequence[Event], exports: Exports) -> SetPointTable:
    """Table of two points with the joints, events and analog outputs of a job."""
    import numpy as np

    from armcontour.files.exports.table import tabulate
    from armcontour.motion import Samples, TimedEvent

    zeros = np.zeros((2, job.arm.dof))
    point = tuple(job.arm.tool_position(zeros)[0].tolist())
    samples = Samples(t=np.array([0.0, cycle]), q=zeros, dq=zeros, ddq=zeros)
    return tabulate(
        samples,
        name=_title(job, REFERENCE),
        cycle=cycle,
        events=tuple(
            TimedEvent(name=y.name, value=y.value, t=0.0, due=0.0, s=0.0, point=point)
            for y in events
        ),
        analog={y: np.zeros(2) for y in job.process.analog_names},
        **exports.table_options(job.arm) | {"effort": samples if exports.effort else None},
    )


def _title(job: Job, label: str) -> str:
    """Title of a table, which is also written to the file."""
    return f"{job.name} {label}"


def write_exports(
    folder: ResultFolder, job: Job, name: str, result: RunResult, exports: Exports
) -> tuple[list[str], list[str]]:
    """Export set-points and plan of a run; returns sentences about the files, and warnings."""
    from armcontour.files.exports import make_table
    from armcontour.files.exports.file_parts import part_files
    from armcontour.files.exports.formats import FORMATS, WITH_ANALOG
    from armcontour.jobs import analog_outputs

    analog = analog_outputs(result.path, result.trajectory, job.process, result.run.limits)
    takers = ", ".join(name for name, kind in FORMATS.items() if issubclass(kind, WITH_ANALOG))
    warnings = [
        f"{y.option}, run {name}: the format does not support analog outputs "
        f"({', '.join(analog)}); these formats do: {takers}."
        for y in exports.targets
        if analog and not isinstance(y.format, WITH_ANALOG)
    ]
    options, written = exports.table_options(job.arm), list[str]()
    made: dict[tuple[str, float, bool], SetPointTable] = {}
    for target in exports.targets:
        tables: dict[str, tuple[SetPoints | Trajectory, float]]
        tables = {REFERENCE: (result.trajectory, exports.cycle_of(target) or result.run.cycle)}
        if not target.plans:
            tables[SET_POINTS] = (result.set_points, result.run.cycle)
        sentences = dict[str, None]()
        for label, (data, cycle) in tables.items():
            title = _title(job, label)
            at_stops = target.format.at_stops
            table = made.get((label, cycle, at_stops)) or make_table(
                data, name=title, cycle=cycle, analog=analog, at_stops=at_stops, **options
            )
            made[label, cycle, at_stops] = table
            filled = exports.with_tolerances(target, label, result)
            parts = filled.format.parts(table)
            sentences |= dict.fromkeys(exports.describe(target, parts))
            files = part_files(FilePath(f"{name}/export/{label}{target.ending}"), len(parts))
            sizes = [
                _place(folder, file.as_posix(), exports, filled, part)
                for file, part in zip(files, parts, strict=True)
            ]
            several = f" to {files[-1].name}" if len(parts) > 1 else ""
            written.append(f"Exported {files[0].as_posix()}{several}: {_total(table, sizes)}.")
        if target.format.kind in JOINED_BY_QUINTICS:
            if table.dq is None and job.arm.name.lower().startswith("ur"):
                warnings.append(
                    f"{target.option}, run {name}: the trajectory interface of UR (passthrough "
                    "controller) requires velocities. Use --derivatives 2."
                )
            warnings += _warn_of_jumps(target, table, result, job)
        warnings += [f"{target.option}, run {name}: {x}" for x in sentences]
    return written, warnings


def _place(
    folder: ResultFolder, name: str, exports: Exports, target: Target, table: SetPointTable
) -> int:
    """Write a table to the result folder; returns its size in bytes."""
    sizes: list[int] = []

    def write(file: FilePath) -> None:
        exports.write(target, table, file)
        sizes.append(_size(file))

    folder.place(name, write)
    return sizes[0]


def _size(file: FilePath) -> int:
    """Size of a file or folder in bytes."""
    parts = [file] if file.is_file() else [y for y in file.rglob("*") if y.is_file()]
    return sum(y.stat().st_size for y in parts)


def _total(table: SetPointTable, sizes: Sequence[int]) -> str:
    """Text with the number of files, the number of points and the total size."""
    size = digits(max(sum(sizes) / MEGABYTE, 1e-3), 2)
    several = f"{len(sizes)} files, " if len(sizes) > 1 else ""
    return f"{several}{count_noun(len(table.t), 'point')}, {size} MB"


def _warn_of_jumps(target: Target, table: SetPointTable, result: RunResult, job: Job) -> list[str]:
    """Warnings if exported accelerations exceed command limits, or by far the joint limits."""
    import numpy as np

    from armcontour.motion.trajectory import COMMAND_SLACK
    from armcontour.robot.limit_use import use_of

    commands = table.command_limits
    limits = result.run.limits if commands is None else commands
    if table.ddq is None or limits.joint_acceleration is None:
        return []
    ratio = use_of("joint_acceleration", limits, table.ddq).largest
    joint = int(np.argmax(ratio))
    if ratio[joint] < (MAX_ACCELERATION_RATIO if commands is None else 1 + COMMAND_SLACK):
        return []
    effect = " Without --derivatives, files have only positions, which satisfy command_limits."
    if commands is None:
        effect = _try_command_limits(result, job)
    return [
        f"{target.option}, run {result.run.name}: a controller that follows the exported "
        f"accelerations requires up to {ratio[joint]:.3g} times the acceleration limit of "
        f"{table.joint_names[joint]}.{effect}"
    ]


def _try_command_limits(result: RunResult, job: Job) -> str:
    """Sentence on the effect of the run's acceleration limits as command limits, or empty."""
    from armcontour.control.compensation.nearest_set_points import limit_set_points
    from armcontour.core.errors import CompensationError
    from armcontour.core.render import number
    from armcontour.robot import Limits

    allowed = Limits.only(joint_acceleration=result.run.limits.joint_acceleration)
    servo = job.servo.for_joints(job.arm.dof)
    try:
        cost = limit_set_points(result.set_points, servo, allowed, job.arm).limit_cost
    except CompensationError:
        return ""
    if cost is None or cost.contour_max is None:
        return ""
    return (
        " With the same limits as command_limits, the differences of the set-points satisfy them, "
        f"and cause a contour error of {number(cost.contour_max, 'm')}."
    )


def export_stored(result: FilePath, file: FilePath, options: StoredExportOptions) -> None:
    """Export a run of an earlier result to a file, and print a summary."""
    from armcontour.cli.console import Console
    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import Interval
    from armcontour.core.render import figure
    from armcontour.core.text import capitalise
    from armcontour.files.cell import read_cell_arm
    from armcontour.files.exports.file_parts import part_files
    from armcontour.files.exports.formats import write_destination
    from armcontour.files.trajectory_file import read_run
    from armcontour.verification.evaluation import duration_row

    requested = [x for x in ("template", "format") if getattr(options, x) is not None]
    option = f"--{requested[0]} {getattr(options, requested[0])}" if requested else file.name
    target = Target(format=_format(file, options), ending=file.suffix, option=option)
    (target,) = _with_options([target], options)
    cycle = read_option("--cycle", options.cycle, Interval)
    if cycle is not None and not options.reference:
        raise InvalidInput("--cycle requires --reference, because set-points have a fixed cycle.")
    arm = None
    if options.job is not None:
        arm = read_cell_arm(options.job, trust_xacro=options.trust_xacro)
    elif options.tool_motion:
        raise InvalidInput(
            "--tool-motion requires the arm. Specify its job file or cell with --job."
        )
    run = read_run(result, options.run_name)
    table_options: dict[str, Any] = {
        "derivatives": options.derivatives,
        "tool_motion": options.tool_motion,
    }
    table = (
        run.reference(cycle, arm=arm, **table_options)
        if options.reference
        else run.set_points(arm=arm, **table_options)
    )
    exports = Exports(targets=(target,))
    _refuse_outputs(exports, {event.name for event in table.events}, f"the run {run.name}")
    parts = target.format.parts(table)
    files = part_files(file, len(parts))
    for path in files:
        if not options.force and path.exists():
            raise InvalidInput(
                f"{path} already exists. Choose another name, or add --force to replace it."
            )
    for path, part in zip(files, parts, strict=True):
        write_destination(
            path, partial(exports.write, target, part), folder=target.format.kind == "mcap"
        )
    for sentence in exports.describe(target, parts):
        Console().print(f"Warning: {capitalise(sentence)}")
    label = REFERENCE if options.reference else SET_POINTS
    if run.analog:
        Console().print(
            f"The analog outputs {', '.join(run.analog)} are not exported, because a stored result "
            "does not contain their values. Export them with armcontour run."
        )
    size = _total(table, [_size(x) for x in files])
    place = f"{files[0]} to {files[-1].name}" if len(files) > 1 else f"{files[0]}"
    motion = figure(duration_row(table.duration))
    Console().print(f"Exported {label} of run {run.name}: {size}, {motion}: {place}")


def _format(file: FilePath, options: StoredExportOptions) -> ExportFormat:
    """Format of a file according to the options or the file name extension."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files.exports.formats import TemplateFormat, format_named, format_of

    if options.template is not None:
        if options.format not in (None, "template"):
            raise InvalidInput(
                f"--template requires --format template or no --format, but the format is "
                f"{options.format}."
            )
        return TemplateFormat(template=options.template)
    kind = format_of(file) if options.format is None else format_named(options.format)
    if kind is TemplateFormat:
        raise InvalidInput(
            "The format template requires a template. Specify kuka, abb or a file with --template."
        )
    return kind()
