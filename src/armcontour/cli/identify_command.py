"""The command `identify`: identifies servos; prints and writes the result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armcontour.cli.console import print_json, print_lines, refuse_force, result_folder, show_data
from armcontour.cli.inputs import read_option, read_window
from armcontour.cli.options import IdentifyOptions
from armcontour.cli.program import ROBOT, command
from armcontour.cli.progress_bars import show_progress

if TYPE_CHECKING:
    from armcontour.control.identification import Identification
    from armcontour.core.result import Data, Row
    from armcontour.motion import Log

# Exit codes. DONE: every joint has a valid model and the compensation is trusted. PROVISIONAL:
# trusted for one program only. DOUBTFUL: otherwise. No error has the exit code 9.
DONE, DOUBTFUL, PROVISIONAL = 0, 1, 9
STOPPED_EARLY = "nothing was identified."


@command(ROBOT, "identify shake.csv --out servo")
def identify(
    logs: Annotated[
        list[FilePath],
        typer.Argument(
            metavar="LOG...",
            help="Log of time, command and measured: CSV; several are joined. With --on, a job.",
        ),
    ],
    options: IdentifyOptions,
) -> int:
    """Identify servos from logs; with --on, from new motions.

    Exit codes: 0 good, 1 a joint or the compensation is doubtful, 9 good for one program only.
    """
    from armcontour.cli.check_command import named_arm
    from armcontour.cli.play_command import refuse_without_controller
    from armcontour.control import identification
    from armcontour.core.render import plain
    from armcontour.core.result import Row
    from armcontour.files.robot_file import servo_yaml

    refuse_force(options)
    if options.on is not None:
        return _identify_robot(logs, options)
    others = {"run_name": "--run", "sets": "--set"}
    refuse_without_controller(options, others)
    arm = None if options.arm is None else named_arm(options.arm)
    unseen = [_read(log, options) for log in options.validate or []]
    fitting = identification.ServoFit(
        model=options.model, kinematics=arm, **_shared_options(options)
    )
    samples = [_read(log, options) for log in logs]
    with show_progress("identifying") as progress:
        fit = identification.identify(samples, fitting, progress=progress)
    predictions = [fit.predict(log) for log in unseen]
    printed = predictions or [fit.predict(log) for log in fit.logs if arm is not None]
    rows = [Row("predictions", [plain(y.to_data()) for y in predictions])] if predictions else []
    files = {"servo.yaml": servo_yaml(fit)} if any(y.written for y in fit.joints) else {}
    _conclude(fit, options, files, rows, [y.to_data(arm) for y in printed])
    return _verdict(fit)


def _verdict(fit: Identification) -> int:
    """Exit code of a servo identification."""
    if not fit.trusted:
        return DOUBTFUL
    return PROVISIONAL if fit.judgement.programs == 1 else DONE


def _identify_robot(jobs: list[FilePath], options: IdentifyOptions) -> int:
    """Identify the servos of a robot from motions that it executes, and return the exit code."""
    from armcontour.cli.play_command import DRY, STOPPED
    from armcontour.cli.robot_commands import identify_robot
    from armcontour.core.checks import raise_if
    from armcontour.files.log_file import log_text
    from armcontour.files.robot_file import servo_yaml

    raise_if(len(jobs) != 1, f"--on requires exactly one job, but {len(jobs)} files are given.")
    for name in ("arm", "validate", "columns", "start", "end"):
        option = {"start": "from", "end": "to"}.get(name, name)
        raise_if(
            getattr(options, name) is not None,
            f"--{option} applies only to logs. Remove --{option} or --on.",
        )
    result = identify_robot(jobs[0], options, _shared_options(options))
    fit = result.fit
    if fit is None:
        if options.as_json:
            print_json(result.to_data())
        else:
            show_data(result.to_data())
            print_lines(f"Stopped: {STOPPED_EARLY}" if result.stopped else DRY)
        return STOPPED if result.stopped else DONE
    files = {f"{name}.csv": log_text(log) for name, log in result.logs.items()}
    remark = ""
    if any(y.written for y in fit.joints):
        files = {"servo.yaml": servo_yaml(fit), **files}
        remark = f". To use the identified servo, copy the key servo of servo.yaml to {jobs[0]}."
    prediction = result.prediction
    assert prediction is not None
    arm = result.played["run"].job.arm
    _conclude(fit, options, files, further=[prediction.to_data(arm)], remark=remark)
    return _verdict(fit)


def _shared_options(options: IdentifyOptions) -> dict[str, Any]:
    """Specified options of the fit, by name."""
    from armcontour.core.quantities import Interval

    chosen = {
        "interpolation": options.interpolation,
        "drive_cycle": read_option("--drive-cycle", options.drive_cycle, Interval),
    }
    return {name: value for name, value in chosen.items() if value is not None}


def _read(log: FilePath, options: IdentifyOptions) -> Log:
    """Read a log, and print its notes."""
    from armcontour.files.log_file import read_log

    start, end = read_window(options.start, options.end)
    content = read_log(
        log,
        start=start,
        end=end,
        columns=options.columns,
    )
    print_lines(*(f"Note: {x}" for x in content.notes), err=True)
    return content


def _conclude(
    fit: Any,
    options: IdentifyOptions,
    files: dict[str, str],
    rows: list[Row] | None = None,
    further: list[Data] | None = None,
    remark: str = "",
) -> None:
    """Write an identification to the result folder, if any, and print it.

    `rows`: further rows of the JSON output; `further`: further printed results; `remark`: end of
    the last printed line.
    """
    from armcontour.core.result import Row
    from armcontour.files.result_folder import data_json
    from armcontour.report.identification import render_identification

    data = fit.to_data()
    page = replace(data, rows=(*data.rows, *(rows or [])))
    with result_folder(options) as folder:
        if folder is not None:
            for name, text in files.items():
                folder.write(name, text)
            folder.write("report.html", render_identification(fit))
            listed = Row("files", [*folder.files, "summary.json"])
            folder.write("summary.json", data_json(replace(page, rows=(*page.rows, listed))))
    if options.as_json:
        print_json(page)
    else:
        for y in (data, *(further or [])):
            show_data(y)
        if options.out is not None:
            print_lines(f"Written to {options.out}: {', '.join([*files, 'report.html'])}{remark}")
