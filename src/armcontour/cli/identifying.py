"""The command `identify`: identify a servo from a log, print and write the result."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import Console, open_page

if TYPE_CHECKING:
    from armcontour.cli.options import IdentifyOptions
    from armcontour.identification import Estimate, Identification


def identify_file(log: FilePath, x: IdentifyOptions) -> bool:
    """Identify a servo from a log and print the result; returns whether the servo is determined.

    Args:
        log: CSV file, or bag of ROS.
        x: Options of the command; the folder gets servo.yaml (if the servo is determined),
            report.html and summary.json.

    Raises:
        InvalidInput: A file or option that cannot be used.
    """
    from armcontour._quantities import Interval, Moment
    from armcontour.cli.progress import search_progress
    from armcontour.cli.quantities import read_option
    from armcontour.errors import InvalidInput
    from armcontour.identification import identify
    from armcontour.io.log_file import read_log
    from armcontour.io.servo_file import identification_json

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    start, end = read_option("--from", x.start, Moment), read_option("--to", x.end, Moment)
    longest = read_option("--longest-dead-time", x.longest_dead_time, Interval)
    assert longest is not None
    samples = read_log(
        log,
        start=-math.inf if start is None else start,
        end=math.inf if end is None else end,
        unwrap=x.unwrap,
        columns=x.columns,
        topic=x.topic,
    )
    with search_progress("identifying") as progress:
        found = identify(
            samples,
            model=x.model,
            interpolation=x.interpolation,
            longest_dead_time=longest,
            progress=progress,
        )
    refusal = _write_results(found, x.out, force=x.force) if x.out is not None else ""
    if x.as_json:
        print(identification_json(found), end="")
    else:
        _print(found, x.out, refusal)
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")
    return found.determined


def _write_results(found: Identification, out: FilePath, *, force: bool) -> str:
    """Write the result folder; returns why there is no servo.yaml, or an empty text."""
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder
    from armcontour.io.servo_file import identification_json, servo_yaml
    from armcontour.report.identification import render_identification

    refusal = ""
    with ResultFolder(out, force=force) as folder:
        try:
            folder.write("servo.yaml", servo_yaml(found))
        except InvalidInput as error:
            # Not an error here: the report shows the cause.
            refusal = str(error)
        folder.write("report.html", render_identification(found))
        folder.write("summary.json", identification_json(found, [*folder.files, "summary.json"]))
    return refusal


def _print(found: Identification, out: FilePath | None, refusal: str) -> None:
    """Print a table of the parameters, and sentences on the fit."""
    console = Console()
    console.show_table(
        [
            "joint",
            "parameter",
            "value",
            "standard deviation",
            "95 % interval",
            "unit",
            "determined",
        ],
        [
            [joint.name, x.name.replace("_", " "), *_cells(x)]
            for joint in found.joints
            for x in joint.estimates
        ],
        title=f"Servo identified from {found.log.source}",
        left=(0, 1, 5, 6),
    )
    _print_fit(console, found)
    if out is not None:
        what = (
            f"report.html, but no servo.yaml: {refusal}" if refusal else "servo.yaml, report.html"
        )
        console.say(f"Written to {out}: {what}")


def _print_fit(console: Console, found: Identification) -> None:
    """Print sentences on the fit of every joint, and advice for undetermined parameters."""
    lines = []
    for joint in found.joints:
        if not math.isnan(joint.r_squared):
            white = "white" if joint.white else "not white"
            order = "velocity loop" if joint.order == "second" else "lag"
            lines.append(
                f"{joint.name}: {order}, {joint.r_squared * 100:.4f} % of the motion explained, "
                f"residuals {joint.rms * 1e3:.3g} mrad rms, {white}."
            )
        open_ones = [x for x in joint.estimates if not x.determined]
        # Several parameters may have the same advice.
        for advice in dict.fromkeys(x.advice for x in open_ones):
            names = ", ".join(x.name.replace("_", " ") for x in open_ones if x.advice == advice)
            lines.append(f"{joint.name}, {names}: {advice}")
        lines += [f"{joint.name}: {note}" for note in joint.notes]
    for line in lines:
        console.say(line)


def _cells(x: Estimate) -> list[str]:
    """An estimate as cells of a table."""
    scale, unit = (1e3, "ms") if x.name == "dead_time" else (1.0, x.unit)

    def shown(value: float, digits: int = 5) -> str:
        return "" if math.isnan(value) else f"{value * scale:.{digits}g}"

    return [
        shown(x.value),
        shown(x.sd, 2),
        f"above {shown(x.low)}" if x.high == math.inf else f"{shown(x.low)} to {shown(x.high)}",
        unit,
        "yes" if x.determined else "no",
    ]
