"""The command `identify`: identify servos or an arm with masses, print and write the result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page, show_notes

if TYPE_CHECKING:
    from armcontour.cli.options import IdentifyOptions
    from armcontour.core.result import Data, Row
    from armcontour.motion import Log
    from armcontour.robot import Arm

# Exit codes: all joints have a good model and compensation is trusted (with masses: all is
# determined), not so, and so on one program only. No error has the code 9.
DONE, DOUBTFUL, PROVISIONAL = 0, 1, 9


def identify_files(logs: list[FilePath], x: IdentifyOptions) -> int:
    """Identify servos or an arm with masses, print the result, and return the exit code.

    Args:
        logs: CSV files, or bags of ROS.
        x: Options of the command; the folder gets servo.yaml (if a joint has a model), with
            masses robot.yaml, and report.html and summary.json.

    Raises:
        InvalidInput: A file or option that cannot be used.
    """
    from armcontour.cli.checking import named_arm
    from armcontour.core.checks import raise_if

    lonely = x.out is None and (x.open_report or x.force)
    raise_if(lonely, "--open and --force go with --out, the folder for the report.")
    if x.arm is None:
        of_arm = ("servo", "gravity", "tip", "base", "joint_limits", "package", "xacro_arg")
        for name in of_arm:
            message = f"--{name.replace('_', '-')} goes with --arm: name the arm too."
            raise_if(getattr(x, name) is not None, message)
        return _identify_servos(logs, x, None)
    raise_if(
        x.out is not None and bool(x.package or x.xacro_arg),
        "robot.yaml cannot name packages and arguments of a .xacro file: expand it to a .urdf "
        "file and name that, or leave --out out.",
    )
    arm = named_arm(x.arm, x)
    if not arm.has_bodies and x.servo is None and x.gravity is None:
        return _identify_servos(logs, x, arm)
    for option, given in (("--predict", bool(x.predict)), ("--model", x.model != "auto")):
        raise_if(given, f"{option} is for joints without an arm: leave it or --arm out.")
    return _identify_bodies(logs, x, x.arm, arm)


def _identify_servos(logs: list[FilePath], x: IdentifyOptions, arm: Arm | None) -> int:
    """Identify the servo of every joint of some logs; the arm gives errors at the tool."""
    from armcontour.cli.progress import search_progress
    from armcontour.control.identification import ServoFit, identify
    from armcontour.core.render import plain
    from armcontour.core.result import Row
    from armcontour.files.servo_file import servo_yaml

    unseen = [_read(log, x) for log in x.predict or []]
    options = ServoFit(model=x.model, kinematics=arm, **_shared_options(x))
    samples = [_read(log, x) for log in logs]
    with search_progress("identifying") as progress:
        found = identify(samples, options, progress=progress)
    predictions = [found.predict(log) for log in unseen]
    shown = predictions or [found.predict(log) for log in found.logs if arm is not None]
    rows = [Row("predictions", [plain(y.to_data()) for y in predictions])] if predictions else []
    files = {"servo.yaml": servo_yaml(found)} if any(y.written for y in found.joints) else {}
    _conclude(found, x, files, rows, [y.to_data(arm) for y in shown])
    if any(y.note for y in found.joints) or not found.judgement.trusted:
        return DOUBTFUL
    return PROVISIONAL if found.judgement.programs == 1 else DONE


def _identify_bodies(logs: list[FilePath], x: IdentifyOptions, name: str, arm: Arm) -> int:
    """Identify an arm with masses from logs."""
    from armcontour.cli.progress import search_progress
    from armcontour.control.identification import BodyFit, identify_bodies
    from armcontour.core.errors import InvalidInput
    from armcontour.files.robot_file import read_servo, robot_servo_yaml, robot_yaml
    from armcontour.files.robots.loading import arm_names

    servo = None if x.servo is None else read_servo(x.servo, arm.dof)
    options = BodyFit(gravity=x.gravity, **_shared_options(x))
    samples = [_read(log, x) for log in logs]
    with search_progress("identifying") as progress:
        found = identify_bodies(samples, arm, servo, options, progress=progress)
    if x.out is None:
        _conclude(found, x, {})
    else:
        base: str | dict[str, str] = name
        if name not in arm_names():
            given = {"file": name, "tip": x.tip, "base": x.base, "joint_limits": x.joint_limits}
            base = {key: str(value) for key, value in given.items() if value is not None}
        files, remark = {"robot.yaml": robot_yaml(found, base, x.out)}, ""
        try:
            files["servo.yaml"] = robot_servo_yaml(found)
        except InvalidInput as error:
            # Not an error here: what else is known is of use.
            remark = f", but no servo.yaml: {error}"
        _conclude(found, x, files, remark=remark)
    return DONE if found.determined else DOUBTFUL


def _shared_options(x: IdentifyOptions) -> dict[str, Any]:
    """The options that both kinds of identification have; without those that are not given."""
    from armcontour.cli.quantities import read_option
    from armcontour.core.quantities import Interval

    given = {
        "interpolation": x.interpolation,
        "longest_dead_time": read_option("--longest-dead-time", x.longest_dead_time, Interval),
        "drive_cycle": read_option("--drive-cycle", x.drive_cycle, Interval),
    }
    return {name: value for name, value in given.items() if value is not None}


def _read(log: FilePath, x: IdentifyOptions) -> Log:
    """Read a log."""
    from armcontour.cli.quantities import read_window
    from armcontour.files.log_file import read_log

    start, end = read_window(x.start, x.end)
    found = read_log(
        log,
        start=start,
        end=end,
        unwrap=x.unwrap,
        columns=x.columns,
        topic=x.topic,
    )
    show_notes(found.notes)
    return found


def _conclude(
    found: Any,
    x: IdentifyOptions,
    files: dict[str, str],
    rows: list[Row] | None = None,
    more: list[Data] | None = None,
    remark: str = "",
) -> None:
    """Write the result folder, and print the result.

    Args:
        found: The identification.
        x: Options of the command.
        files: Texts of the files of the folder, by their names.
        rows: Further figures in JSON.
        more: Further results in print.
        remark: What is said of the files.
    """
    from armcontour.core.result import Row
    from armcontour.files import ResultFolder
    from armcontour.files.json_text import data_json
    from armcontour.report.identification import render_identification

    data = found.to_data()
    page = replace(data, rows=(*data.rows, *(rows or [])))
    if x.out is not None:
        with ResultFolder(x.out, force=x.force) as folder:
            for name, text in files.items():
                folder.write(name, text)
            folder.write("report.html", render_identification(found))
            listed = Row("files", [*folder.files, "summary.json"])
            folder.write("summary.json", data_json(replace(page, rows=(*page.rows, listed))))
    if x.as_json:
        print(data_json(page), end="")
    else:
        console = Console()
        for y in (data, *(more or [])):
            console.show(y)
        if x.out is not None:
            console.say(f"Written to {x.out}: {', '.join([*files, 'report.html'])}{remark}")
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")
