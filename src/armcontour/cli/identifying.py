"""The command `identify`: identify a servo or a robot from logs, print and write the result."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page, show_notes

if TYPE_CHECKING:
    from armcontour.arms import Arm
    from armcontour.cli.options import IdentifyOptions
    from armcontour.identification import Identification, Prediction, RobotIdentification
    from armcontour.motion import Log

# Exit codes: all joints have a good model and compensation is trusted (with masses: all is
# determined), not so, and so on one program only. No error has the code 9.
DONE, DOUBTFUL, PROVISIONAL = 0, 1, 9


def identify_files(logs: list[FilePath], x: IdentifyOptions) -> int:
    """Identify a servo or a robot, print the result, and return the exit code.

    Args:
        logs: CSV files, or bags of ROS.
        x: Options of the command; the folder gets servo.yaml (if a joint has a model), with an
            arm robot.yaml, and report.html and summary.json.

    Raises:
        InvalidInput: A file or option that cannot be used.
    """
    from armcontour.errors import InvalidInput

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    if x.arm is None:
        of_arm = ("servo", "gravity", "tip", "base", "joint_limits", "package")
        for name in (*of_arm, "xacro_arg"):
            if getattr(x, name) is not None:
                raise InvalidInput(f"--{name.replace('_', '-')} goes with --arm: name the arm too.")
        code = _identify_servo(logs, x, None)
    else:
        code = _identify_robot(logs, x, x.arm)
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")
    return code


def _identify(logs: list[FilePath], x: IdentifyOptions, **own: Any) -> Any:
    """Identify with the options of both kinds of results, and with options of one kind."""
    from armcontour._quantities import Interval
    from armcontour.cli.progress import search_progress
    from armcontour.cli.quantities import read_option
    from armcontour.identification import identify

    own["longest_dead_time"] = read_option("--longest-dead-time", x.longest_dead_time, Interval)
    own["drive_cycle"] = read_option("--drive-cycle", x.drive_cycle, Interval)
    samples = [_read(log, x) for log in logs]
    with search_progress("identifying") as progress:
        return identify(samples, interpolation=x.interpolation, progress=progress, **own)


def _read(log: FilePath, x: IdentifyOptions) -> Log:
    """Read a log."""
    from armcontour.cli.quantities import read_window
    from armcontour.io.log_file import read_log

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


def _identify_servo(logs: list[FilePath], x: IdentifyOptions, arm: Arm | None) -> int:
    """Identify the servo of every joint of some logs; the arm gives errors at the tool."""
    from armcontour.io.json_text import data_json

    unseen = [_read(log, x) for log in x.predict or []]
    found: Identification = _identify(logs, x, model=x.model, kinematics=arm)
    predictions = [found.predict(log) for log in unseen]
    if x.out is not None:
        _write_results(found, predictions, x.out, x.force)
    if x.as_json:
        print(data_json(found.to_data(predictions)), end="")
    else:
        console = Console()
        console.show(found.to_data())
        fitted = [] if arm is None else [found.predict(log) for log in found.logs]
        for prediction in predictions or fitted:
            console.show(prediction.to_data(arm))
        if x.out is not None:
            servo = "servo.yaml, " if any(joint.written for joint in found.joints) else ""
            console.say(f"Written to {x.out}: {servo}report.html")
    if any(joint.note for joint in found.joints) or not found.judgement.trusted:
        return DOUBTFUL
    return PROVISIONAL if found.judgement.programs == 1 else DONE


def _identify_robot(logs: list[FilePath], x: IdentifyOptions, name: str) -> int:
    """Identify a robot with masses from logs, or joints of an arm without."""
    from armcontour.cli.checking import named_arm
    from armcontour.errors import InvalidInput
    from armcontour.io.json_text import data_json
    from armcontour.io.robot_file import read_servo

    if x.out is not None and (x.package or x.xacro_arg):
        raise InvalidInput(
            "robot.yaml cannot name packages and arguments of a .xacro file: expand it to a .urdf "
            "file and name that, or leave --out out."
        )
    arm = named_arm(name, x)
    if not arm.has_bodies and x.servo is None and x.gravity is None:
        return _identify_servo(logs, x, arm)
    for option, given in (("--predict", x.predict), ("--model", x.model != "auto")):
        if given:
            raise InvalidInput(f"{option} is for joints without an arm: leave it or --arm out.")
    servo = None if x.servo is None else read_servo(x.servo, arm.dof)
    found: RobotIdentification = _identify(logs, x, arm=arm, servo=servo, gravity=x.gravity)
    written = _write_robot(found, x, name, x.out) if x.out is not None else ""
    if x.as_json:
        print(data_json(found.to_data()), end="")
    else:
        console = Console()
        console.show(found.to_data())
        if written:
            console.say(written)
    return DONE if found.determined else DOUBTFUL


def _write_robot(found: RobotIdentification, x: IdentifyOptions, name: str, out: FilePath) -> str:
    """Write the result folder; returns a sentence that lists the files."""
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder
    from armcontour.io.json_text import data_json
    from armcontour.io.robot_file import robot_servo_yaml, robot_yaml
    from armcontour.io.robots.loading import arm_names
    from armcontour.report.identification import render_robot

    base: str | dict[str, str] = name
    if name not in arm_names():
        given = {"file": name, "tip": x.tip, "base": x.base, "joint_limits": x.joint_limits}
        base = {key: str(value) for key, value in given.items() if value is not None}
    servo = "servo.yaml"
    with ResultFolder(out, force=x.force) as folder:
        folder.write("robot.yaml", robot_yaml(found, base, out))
        try:
            folder.write("servo.yaml", robot_servo_yaml(found))
        except InvalidInput as error:
            # Not an error here: what else is known is of use.
            servo = f"but no servo.yaml: {error}"
        folder.write("report.html", render_robot(found))
        folder.write("summary.json", data_json(found.to_data([*folder.files, "summary.json"])))
    return f"Written to {out}: robot.yaml, report.html, {servo}"


def _write_results(
    found: Identification, predictions: list[Prediction], out: FilePath, force: bool
) -> None:
    """Write the result folder; without servo.yaml if no joint has a model."""
    from armcontour.io import ResultFolder
    from armcontour.io.json_text import data_json
    from armcontour.io.servo_file import servo_yaml
    from armcontour.report.identification import render_identification

    with ResultFolder(out, force=force) as folder:
        if any(joint.written for joint in found.joints):
            folder.write("servo.yaml", servo_yaml(found))
        folder.write("report.html", render_identification(found))
        files = [*folder.files, "summary.json"]
        folder.write("summary.json", data_json(found.to_data(predictions, files)))
