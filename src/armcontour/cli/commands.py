"""The commands of `armcontour` with their arguments and options, in the order of the help.

A command is a dataclass, whose decorator names the module that does its work. The options of a base
class are a panel in the help, whose title is the first sentence of the docstring. Commands are
neither compared nor printed; without these methods, `--help` starts 12 ms sooner.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import typer

from armcontour import files
from armcontour.cli.command_execution import Json, Results
from armcontour.cli.command_line import INSTALLED, JUDGE, PREPARE, ROBOT, RUN, command, program_for
from armcontour.cli.job_options import (
    CERTIFICATE,
    DRAWING,
    EXPORTED_POINTS,
    EXPORTS,
    FIRST_RUN,
    MODEL,
    POSITION,
    SPEED,
)

__all__ = ["program_for"]
# Values of the options that set keys of a job, by parameter; its annotation has their topics.
Keys: TypeAlias = dict[str, Any]
Text: TypeAlias = str | None
File: TypeAlias = FilePath | None
Argument = Annotated[FilePath, typer.Argument()]
RequiredOut = Annotated[FilePath, typer.Option("--out", "-o")]
Name = Annotated[str | None, typer.Option("--run")]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SetOptions:
    """Speed, corners and start.

    Args:
        sets: Any key of the job with its value, as in limits.speed='0.2 m/s' or
            runs.fast.timing.reserve=2%; may be repeated.
    """

    sets: Annotated[list[str] | None, typer.Option("--set")] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CellOptions:
    """Cell and position of the drawing.

    Args:
        cell: Cell for a drawing: a built-in cell (fr3, panda, pmk3s, ur10e, ur10e_positioner,
            ur5e), or a job file without a path.
    """

    cell: Text = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JobOptions(CellOptions, SetOptions):
    """Job.

    Args:
        job: Job file (.yaml); or a drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), waypoints
            (.csv), or CAD model (.step), with --cell.
    """

    job: Argument
    keys: Annotated[Keys, SPEED, DRAWING, MODEL, POSITION] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WorkerOptions:
    """Processes.

    Args:
        workers: Number of processes on this machine; by default one per processor. 0 uses only this
            process.
    """

    workers: Annotated[int | None, typer.Option("--workers", min=0, max=1000)] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LogOptions:
    """Log and files of numbers.

    Args:
        columns: Names of the columns of a CSV file without a header: 't [ms],q1 [deg],-,q2'; or new
            names of columns or joints: 'q# [deg]=axis_#'.
    """

    columns: Text = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BagOptions(LogOptions):
    """Log and files of numbers.

    Args:
        topic: Topic of a bag of ROS 2, if several have joints: /arm_controller/controller_state.
    """

    topic: Text = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WindowOptions(BagOptions):
    """Log and files of numbers.

    Args:
        start: First time of the log to use, such as '2 s'.
        end: Last time of the log to use, such as '30 s'.
    """

    start: Annotated[Text, typer.Option("--from")] = None
    end: Annotated[Text, typer.Option("--to")] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ControllerOptions:
    """Robot controller.

    Args:
        on: Controller that moves the robot: linuxcnc, franka or ur. The adapter for ur has never
            run on a robot.
        address: Address of a robot (franka, ur).
        hal: HAL file of the machine (linuxcnc); by default joints are simulated.
        drives: File with the key servo, such as a servo.yaml, for the simulated joints (linuxcnc);
            by default the plant of the job. A dead time of one cycle is LinuxCNC's default loop.
        thread_period: Period of the servo thread of simulated joints (linuxcnc), such as '2 ms'; by
            default 1 ms. A HAL file states its own period.
        execute: Move the robot, after its name is typed on the terminal.
    """

    on: Text = None
    address: Text = None
    hal: File = None
    drives: File = None
    thread_period: Annotated[Text, typer.Option("--thread-period")] = None
    execute: bool = False


@command(RUN, "run gasket.dxf --cell ur5e --out gasket --export urscript")
class Run(JobOptions, Results):
    """Run a job or a drawing: writes summary.json, report.html, and trajectories (CSV).

    Exit codes: 0 done, 1 done but no run is kept; others as for errors.

    Args:
        simulate: Simulate the servo, and write a report of it.
        changes: Plan changes of each run, and report those that save most time or turn a violated
            run into a valid one; by default the likeliest, for a quarter of the run's time.
    """

    out: RequiredOut = field()
    keys: Annotated[Keys, SPEED, FIRST_RUN, DRAWING, MODEL, POSITION, EXPORTS, EXPORTED_POINTS] = (
        field(default_factory=dict)
    )
    simulate: Annotated[bool, typer.Option("--simulate/--no-simulation")] = True
    changes: Annotated[bool | None, typer.Option("--changes/--no-changes")] = None


@command(RUN, "demo", "run_command")
class Demo(Results):
    """Run two built-in jobs: the paper's job on the PMK-3s, and a plate that a UR5e cuts."""

    out: RequiredOut = FilePath("demo")
    # An earlier demo is replaced if its files are unchanged.
    kind: ClassVar[str] = "demo"


@command(RUN, "studio gasket.dxf --cell ur5e")
class Studio(CellOptions):
    """Open a web page on which you edit the path and see the resulting robot motion at once.

    Args:
        job: Job file (.yaml), or a drawing, G-code or waypoints with --cell; by default the start
            page.
        open_page: Open the page in a browser.
        port: Port on this machine; 0 for any.
    """

    job: Annotated[File, typer.Argument()] = None
    open_page: Annotated[bool, typer.Option("--open/--no-open")] = True
    port: Annotated[int, typer.Option("--port", min=0, max=65535)] = 0


@command(PREPARE, "show gasket.dxf --layer CUT")
class Show(Json):
    """Show size and layers of a drawing, or parts and edges of a CAD model; no arm is required.

    Args:
        drawing: Drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), waypoints (.csv), or CAD model
            (.step).
        out: HTML file for a picture of a CAD model, with the tool axes along the selected edges.
        force: Replace an earlier picture.
    """

    drawing: Argument
    out: Annotated[File, typer.Option("--out", "-o")] = None
    force: bool = False
    keys: Annotated[Keys, DRAWING, MODEL] = field(default_factory=dict)


@command(RUN, "batch job.yaml --over 'limits.speed=[0.1, 0.2]' --out results", "study_commands")
class Batch(JobOptions, WorkerOptions):
    """Run a job for all combinations of values of its keys.

    Exit codes: 0 every job is done or refused; 1 some jobs failed; 2 no job is valid.

    Args:
        out: New folder for the results.
        over: A key of the job with its values, as in limits.speed='[50 mm/s, 0.1 m/s]'; with
            several keys, all combinations are run.
    """

    out: RequiredOut
    over: Annotated[list[str], typer.Option("--over")]


@command(PREPARE, "place job.yaml --x '-0.3 m .. 0.3 m, 25' --out place", "study_commands")
class Place(JobOptions, WorkerOptions, Results):
    """Plan a job at every place of a grid of its part: writes a map, a table, and the best job.

    Exit codes: 0 done, 1 done but no place is feasible; others as for errors.

    Args:
        x: Displacements along x of the path, and their number: '-300 mm .. 300 mm, 25'.
        y: Displacements along y.
        z: Displacements along z.
        yaw: Rotations about z: '0 deg .. 360 deg, 8'.
        move: Moved object: part, about the middle of its path; or base, about its origin.
        run_name: Run of the job.
    """

    out: RequiredOut = field()
    x: Text = None
    y: Text = None
    z: Text = None
    yaw: Text = None
    move: str = "part"
    run_name: Name = None


@command(PREPARE, "measure part touches.csv --job job.yaml --out measured.yaml")
class Measure(LogOptions, Json):
    """Measure where the part or the tool is, from joint positions at touched points.

    Args:
        target: Measured frame: part (the key path.frame), work (arm.work, so that path.frame does
            not change), or tool (the position of arm.tool).
        touches: Touches: CSV of joint positions, for part and work with the touched points x, y and
            z in the drawing. Without points, the three touches are the origin, a point on the x
            axis, and a point on the side of y.
        job: Job file whose arm touched.
        noise: Standard deviation of each coordinate of a touch.
        accept: Doubts to accept, separated by commas, if the measurement is right: turned_over,
            mirrored, scaled, order, touch.
        out: Job file to write, with the measured frame; by default the frame is only printed.
        force: Replace a file of that name, such as the job itself.
    """

    target: Annotated[Literal["part", "work", "tool"], typer.Argument()]
    touches: Argument
    job: Annotated[FilePath, typer.Option("--job")]
    noise: str = "0.1 mm"
    accept: str = ""
    out: Annotated[File, typer.Option("--out", "-o")] = None
    force: bool = False


@command(PREPARE, "arms", "installation_commands")
class Arms:
    """List the built-in arms with their sources and assumed parameters."""


@command(PREPARE, "init ur5e --out cell.yaml", "installation_commands")
class Init:
    """Write a built-in cell as a job file to edit, with arm, limits, servo and comments.

    Args:
        cell: Built-in cell, by the name of its arm: see `armcontour arms`.
        out: File for the cell (.yaml); by default CELL.yaml.
        force: Replace a file of that name.
    """

    cell: Annotated[str, typer.Argument()] = "ur5e"
    out: Annotated[File, typer.Option("--out", "-o")] = None
    force: bool = False


@command(JUDGE, "check motion.csv --arm ur5e --noise '0.05 mrad'")
class Check(BagOptions, Json):
    """Check a joint trajectory against limits.

    Exit codes: 0 all limits kept, 1 a limit violated, 7 the samples cannot tell, 2 invalid input.

    Args:
        trajectory: Time-stamped joint trajectory: CSV, or a bag or YAML of ROS.
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
        set_points: Check set-points of a controller, as run does: their differences against the
            limits of set-points, of the job or of the arm. The path is not checked, because
            compensated set-points do not follow it.
        repeat: Log of another run of the same program at the same speed, with --path; may be
            repeated. The check states the largest error of all runs, and which runs differ.
    """

    trajectory: Argument
    arm: Text = None
    limits: File = None
    path: File = None
    run_name: Name = None
    scene: Text = None
    noise: Text = None
    controller: Text = None
    rate: Text = None
    set_points: Annotated[bool, typer.Option("--set-points")] = False
    repeat: list[FilePath] | None = None


@command(JUDGE, "certify job.yaml --total-tolerance '1 mm' --out certificate", "study_commands")
class Certify(JobOptions, Results, Json):
    """Find the fastest plan whose execution stays within a tolerance; exit code 4 without one.

    Args:
        run_name: Run of the job.
    """

    keys: Annotated[Keys, SPEED, DRAWING, MODEL, POSITION, CERTIFICATE] = field(
        default_factory=dict
    )
    run_name: Name = None


@command(ROBOT, "export gasket gasket.script")
class Export:
    """Export the set-points or the plan of an earlier result for a robot controller.

    Args:
        result: Folder of a result, of `run`, `certify` or `learn`.
        file: File to write; its extension determines the format.
        run_name: Run of the result.
        format: Format of the file, as --export of run, or a .j2 file; by default determined by its
            extension.
        force: Replace a file of that name.
    """

    result: Argument
    file: Argument
    keys: Annotated[Keys, EXPORTED_POINTS] = field(default_factory=dict)
    run_name: Name = None
    format: Text = None
    force: bool = False


@command(ROBOT, "identify shake.csv --out servo")
class Identify(ControllerOptions, WindowOptions, SetOptions, Results, Json):
    """Identify servos from logs; with --on, from new motions.

    Exit codes: 0 good, 1 a joint or the compensation is doubtful, 9 good for one program only.

    Args:
        logs: Log of time, command and measured: CSV, or a bag of ROS 2; several are joined. With
            --on, a job.
        run_name: With --on, run of the job.
        reserve: With --on, minimum reserve of this run.
        arm: Arm with whose tool the errors are also reported: as for check.
        drive_cycle: Cycle of the drives' loops; by default continuous.
        model: Model of the servo: auto, second or first.
        interpolation: Command between set-points: linear or step; by default determined from
            the log.
        validate: Log that is used only to validate the model; may be repeated.
        assumed: Job, or servo.yaml, whose gains are written for joints that do not move in the
            logs; by default they have no model.
    """

    logs: Annotated[list[FilePath], typer.Argument(metavar="LOG...")]
    run_name: Name = None
    reserve: str = "20 %"
    arm: Text = None
    drive_cycle: Annotated[Text, typer.Option("--drive-cycle")] = None
    model: str = "auto"
    interpolation: Text = None
    validate: list[FilePath] | None = None
    assumed: File = None


@command(ROBOT, "learn job.yaml --set-points result --log robot.csv --out next")
class Learn(JobOptions, ControllerOptions, WindowOptions, Results, Json):
    """Learn the set-points of the next run from logs; with --on, from runs on the robot.

    With --on, earlier runs in the folder of --out are continued.

    Args:
        run_name: Run of the job.
        runs: With --on, number of runs.
        reserve: With --on, minimum reserve of the plan, because corrections need acceleration.
        band: With --on, largest deviation of a joint from the plan before a motion is stopped, such
            as '5 mrad'; by default 3 times the largest one of the best run, in the first run as
            for play.
        set_points: Executed set-points: set_points.csv of run or of the previous learn, or the
            folder of that result.
        log: Log of that run, with positions over time: CSV, or a bag of ROS 2; may be repeated for
            several runs of the same set-points.
    """

    run_name: Name = None
    runs: Annotated[int, typer.Option("--runs", min=1)] = 4
    reserve: str = "20 %"
    band: Text = None
    set_points: Annotated[File, typer.Option("--set-points")] = None
    log: list[FilePath] | None = None

    def claim(self) -> files.ResultFolder | None:
        """Return the folder of --out; None with --on, because each run is then written at once."""
        return None if self.on else super().claim()


@command(ROBOT, "play job.yaml --on linuxcnc --speed-factor '50 %' --execute --out played")
class Play(JobOptions, ControllerOptions, Results, Json):
    """Play a run on a robot controller and record it; the robot moves only with --execute.

    During the motion, space pauses, c pauses at the end of the contour, r goes on, - and + change
    the speed, and q ends the motion on its path. --speed-factor is the speed at the start.

    Args:
        run_name: Run of the job.
        band: Largest difference of a revolute joint from its simulated position before the motion
            is stopped, such as '5 mrad'; by default 2 mrad and the distance that it moves in 50 ms
            at its largest speed. The band of a linear axis is always 2 mm and this distance.
        set_points: Learned set-points: set_points.csv of learn, or its folder. They belong to the
            --speed-factor with which they were learned, and start at 100 % of it.
        resume: Folder of an earlier play of this job (--out) that was stopped or killed: only the
            rest of the job is played. The arm keeps its configuration. With --rejoin, or with
            leads, it first moves back along the path.
    """

    on: str = field()
    keys: Annotated[Keys, SPEED, FIRST_RUN, DRAWING, MODEL, POSITION] = field(default_factory=dict)
    run_name: Name = None
    band: Text = None
    set_points: Annotated[File, typer.Option("--set-points")] = None
    resume: File = None


@command(INSTALLED, "compile usual", "installation_commands")
class Compile:
    """Compile functions now that are otherwise compiled at first use, to avoid later waiting.

    Args:
        functions: Functions to compile: all, or those of usual runs in the plane, in space, or
            both (usual).
    """

    functions: Annotated[Literal["all", "usual", "plane", "space"], typer.Argument()] = "all"


@command(INSTALLED, "schema", "installation_commands")
class Schema:
    """Print the JSON Schema of job files."""
