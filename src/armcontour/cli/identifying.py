"""The command `identify`: identify a servo or a robot from logs, print and write the result."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np

from armcontour._describing import digits
from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.cli.options import IdentifyOptions
    from armcontour.identification import (
        Estimate,
        Identification,
        Prediction,
        RobotIdentification,
    )
    from armcontour.motion import Log

# RMS about the mean, and shares of the variance.
PREDICTED = ["joint", "tracking error [mrad]", "predicted to [mrad]", "explained"]


def identify_files(logs: list[FilePath], x: IdentifyOptions) -> bool:
    """Identify a servo or a robot and print the result.

    Returns whether there is a servo model, with an arm whether all is determined.

    Args:
        logs: CSV files, or bags of ROS.
        x: Options of the command; the folder gets servo.yaml (if there is a servo model), with an
            arm robot.yaml, and report.html and summary.json.

    Raises:
        InvalidInput: A file or option that cannot be used.
    """
    from armcontour.errors import InvalidInput

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    if x.arm is not None:
        if x.predict:
            raise InvalidInput("--predict is for joints without an arm: leave it or --arm out.")
        return _identify_robot(logs, x, x.arm)
    of_arm = ("servo", "gravity", "drive_cycle", "tip", "base", "joint_limits", "package")
    for name in (*of_arm, "xacro_arg"):
        if getattr(x, name) is not None:
            raise InvalidInput(f"--{name.replace('_', '-')} goes with --arm: name the arm too.")
    return _identify_servo(logs, x)


def _read(log: FilePath, x: IdentifyOptions) -> Log:
    """Read a log."""
    from armcontour.cli.quantities import read_window
    from armcontour.io.log_file import read_log

    start, end = read_window(x.start, x.end)
    return read_log(
        log,
        start=start,
        end=end,
        unwrap=x.unwrap,
        columns=x.columns,
        topic=x.topic,
    )


def _identify_servo(logs: list[FilePath], x: IdentifyOptions) -> bool:
    """Identify the servo of every joint of one or several logs."""
    from armcontour._quantities import Interval
    from armcontour.cli.progress import search_progress
    from armcontour.cli.quantities import read_option
    from armcontour.identification import identify
    from armcontour.io.servo_file import identification_json

    longest = read_option("--longest-dead-time", x.longest_dead_time, Interval)
    assert longest is not None
    samples, unseen = ([_read(log, x) for log in some] for some in (logs, x.predict or []))
    with search_progress("identifying") as progress:
        found = identify(
            samples,
            model=x.model,
            interpolation=x.interpolation,
            longest_dead_time=longest,
            progress=progress,
        )
    predictions = [found.predict(log) for log in unseen]
    refusal = _write_results(found, predictions, x.out, x.force)
    if x.as_json:
        print(identification_json(found, predictions), end="")
    else:
        _print(found, predictions, x.out, refusal)
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")
    return not refusal


def _identify_robot(logs: list[FilePath], x: IdentifyOptions, name: str) -> bool:
    """Identify a robot with masses from logs."""
    from armcontour._quantities import Interval
    from armcontour.cli.checking import named_arm
    from armcontour.cli.progress import search_progress
    from armcontour.cli.quantities import read_option
    from armcontour.errors import InvalidInput
    from armcontour.identification import identify
    from armcontour.io.robot_file import read_servo, robot_json

    if x.model != "auto":
        raise InvalidInput("--model is for joints without an arm: leave it or --arm out.")
    if x.out is not None and (x.package or x.xacro_arg):
        raise InvalidInput(
            "robot.yaml cannot name packages and arguments of a .xacro file: expand it to a .urdf "
            "file and name that, or leave --out out."
        )
    longest = read_option("--longest-dead-time", x.longest_dead_time, Interval)
    cycle = read_option("--drive-cycle", x.drive_cycle, Interval)
    assert longest is not None
    arm = named_arm(name, x)
    servo = None if x.servo is None else read_servo(x.servo, arm.dof)
    samples = [_read(log, x) for log in logs]
    with search_progress("identifying") as progress:
        found = identify(
            samples,
            arm=arm,
            servo=servo,
            gravity=x.gravity,
            drive_cycle=cycle,
            interpolation=x.interpolation,
            longest_dead_time=longest,
            progress=progress,
        )
    written = _write_robot(found, x, name, x.out) if x.out is not None else ""
    if x.as_json:
        print(robot_json(found), end="")
    else:
        _print_robot(found, written)
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")
    return found.determined


def _write_robot(found: RobotIdentification, x: IdentifyOptions, name: str, out: FilePath) -> str:
    """Write the result folder; returns a sentence that lists the files."""
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder
    from armcontour.io.robot_file import robot_json, robot_servo_yaml, robot_yaml
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
        folder.write("summary.json", robot_json(found, [*folder.files, "summary.json"]))
    return f"Written to {out}: robot.yaml, report.html, {servo}"


def _print_robot(found: RobotIdentification, written: str) -> None:
    """Print a row per joint, the load, and the parameters that are not determined."""
    console, first = Console(), found.joints[0]
    inertias = found.armature is None
    columns = ["kp", "kv", "viscous", "coulomb", *(["armature"] if inertias else [])]
    console.show_table(
        [
            "joint",
            *(f"{x} [{getattr(first, x).unit}]" for x in columns),
            "residual [mrad]",
        ],
        [
            [joint.name, *(_cell(getattr(joint, x)) for x in columns), f"{joint.rms * 1e3:.3g}"]
            for joint in found.joints
        ],
        title=f"Robot identified from {found.source}, with half widths of 95 % intervals",
    )
    common = ", ".join(
        f"{x.name.replace('_', ' ')} {_cell(x)} {x.shown[1] if x.unit != '1' else 'of nominal'}"
        for x in found.common
    )
    kept = f" Not determined, so nominal: {', '.join(found.open)}." if found.open else ""
    console.say(f"Robot: {common}; gravity compensation {found.gravity}.{kept}")
    if written:
        console.say(written)


def _write_results(
    found: Identification, predictions: list[Prediction], out: FilePath | None, force: bool
) -> str:
    """Write the result folder, if any; returns why there is no servo model, or an empty text."""
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder
    from armcontour.io.servo_file import identification_json, servo_yaml
    from armcontour.report.identification import render_identification

    servo, refusal = None, ""
    try:
        servo = servo_yaml(found)
    except InvalidInput as error:
        # Not an error here: the report shows the cause.
        refusal = str(error)
    if out is None:
        return refusal
    with ResultFolder(out, force=force) as folder:
        if servo is not None:
            folder.write("servo.yaml", servo)
        folder.write("report.html", render_identification(found))
        files = [*folder.files, "summary.json"]
        folder.write("summary.json", identification_json(found, predictions, files))
    return refusal


def _print(
    found: Identification, predictions: list[Prediction], out: FilePath | None, refusal: str
) -> None:
    """Print the result of each joint, and how well it predicts other logs."""
    console = Console()
    rows = []
    for joint in found.joints:
        of = [joint.kp, joint.kv, joint.velocity_feedforward, joint.dead_time]
        errors = _predicted(joint.tracking_rms, joint.predicted_rms, joint.explained)[:2]
        values = ["" if x is None else _cell(x) for x in of]
        rows.append([joint.name, *errors, *values, "yes" if joint.determined else "no"])
    console.show_table(
        [*PREDICTED[:3], "K_p [1/s]", "K_v [1/s]", "f", "dead time [ms]", "determined"],
        rows,
        title=f"Servo identified from {found.log.source}, with half widths of 95 % intervals",
    )
    for y in predictions:
        every = zip(y.log.joint_names, y.tracking_rms, y.rms, y.explained, strict=True)
        console.show_table(
            PREDICTED,
            [[name, *_predicted(*of)] for name, *of in every],
            title=f"Prediction of {y.log.source}",
        )
    console.say(f"There is no servo model: {refusal}" if refusal else _shared_delay(found))
    if out is not None:
        what = "report.html" if refusal else "servo.yaml, report.html"
        console.say(f"Written to {out}: {what}")


def _shared_delay(found: Identification) -> str:
    """A sentence on the dead time that all joints share, and on what differs between them."""
    delays = found.servo_model().for_joints(len(found.joints)).dead_time * 1e3
    return (
        f"All joints are late by {delays.min():.3g} ms, which does not bend the path; their dead "
        f"times differ by {np.ptp(delays):.2g} ms."
    )


def _predicted(tracking: float, predicted: float, explained: float) -> list[str]:
    """Tracking error, error of the prediction, and the share that is predicted, as cells."""
    if not math.isfinite(explained):
        return ["", "", ""]
    share = f"{max(explained, 0.0) * 100:.1f} %"
    return [f"{tracking * 1e3:.3f}", f"{predicted * 1e3:.3f}", share]


def _cell(x: Estimate) -> str:
    """Value of an estimate and half the width of its 95 % interval."""
    scale = x.shown[0]
    if not math.isfinite(x.value):
        return ""
    value, reach = f"{x.value * scale:.4g}", (x.high - x.low) / 2 * scale
    return f"{value} ±{digits(reach, 2)}" if math.isfinite(reach) else value
