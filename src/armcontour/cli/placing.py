"""The command `place`: where the part of a job lies best."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour._progress import under
from armcontour.cli.console import Console, open_page
from armcontour.cli.quantities import read_option, read_option_list

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions, PlaceOptions
    from armcontour.io.job_model import PlacementModel
    from armcontour.placement import Placement

# The job in its best place.
JOB = "job.yaml"
OVER = "--over takes an axis, a range and a number of places, such as 'x: -300 mm .. 300 mm, 25'"
OFF = "--uncertainty takes an axis and a distance or angle, such as 'x: 2 mm'"


def place_file(file: FilePath, out: FilePath, job_options: JobOptions, x: PlaceOptions) -> None:
    """Place a job, print the best place, and write maps, a table and the job in that place.

    Args:
        file: A job file, or a drawing.
        out: Folder for summary.json, placement.csv, report.html and job.yaml.
        job_options: Options that replace values of the job.
        x: Options of the command.

    Raises:
        ArmContourError: An invalid job, or no feasible place; then nothing is written.
    """
    from armcontour._pool import open_executor
    from armcontour.cli.opening import open_job
    from armcontour.cli.progress import share_progress
    from armcontour.errors import InvalidInput
    from armcontour.io import ResultFolder, placement_csv, placement_json
    from armcontour.placement import place

    asked = _asked(file, job_options)
    over = _axes(x.over or [], asked)
    off = dict(_read_uncertainty(text) for text in x.uncertainty or ())
    about = _read_about(x.about)
    # By default places decide by their number.
    own = x.workers is None and x.cluster is None
    with (
        nullcontext() if own else open_executor(x.workers, x.cluster) as executor,
        ResultFolder(out, force=x.force) as folder,
    ):
        from armcontour.report import render_placement

        with share_progress() as progress:
            job = open_job(file, job_options, under(progress, "reading"))
            found = place(
                job,
                x.run_name,
                over=over,
                objective=x.objective,
                uncertainty=off,
                what=x.move,
                absolute=x.absolute,
                about=about,
                every=x.every,
                refined=x.refined,
                executor=executor,
                progress=progress,
            )
        folder.write("report.html", render_placement(found))
        folder.write("placement.csv", placement_csv(found))
        unwritten = ""
        try:
            folder.write(JOB, _job_text(found, file, out, job_options))
        except InvalidInput as error:
            unwritten = str(error)
        files = [*folder.files, "summary.json"]
        folder.write("summary.json", placement_json(found, files))
    report = (out / "report.html").resolve()
    _print(found, report, None if unwritten else out / JOB, unwritten)
    if x.open_report:
        open_page(report)


def _axes(given: Sequence[str], asked: PlacementModel) -> dict[str, tuple[float, float, int]]:
    """The axes of --over with their ranges; none if the job names axes.

    Raises:
        InvalidInput: An axis is wrong or named twice, or there is none.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io.place_axes import AxesModel

    over = dict(read_axis(text) for text in given)
    if not over and asked.over == AxesModel():
        raise InvalidInput(
            "place needs --over for each axis along which to place, or the key placement.over of "
            f"the job: {OVER}."
        )
    if len(over) < len(given):
        raise InvalidInput("--over names an axis twice: give each axis once.")
    return over


def _asked(file: FilePath, options: JobOptions) -> PlacementModel:
    """What the job or the cell has under `placement`.

    Raises:
        InvalidInput: No such file, or invalid keys.
    """
    from armcontour.io.cell import open_keys
    from armcontour.io.job_model import PlacementModel

    named = _text_of(file, options)
    # Opening a drawing without a cell says that it needs one.
    model = None if named is None else open_keys(named)[0].placement
    return model or PlacementModel()


def _text_of(file: FilePath, options: JobOptions) -> str | None:
    """The job file, or the cell of a drawing."""
    from armcontour.cli.opening import is_job

    return str(file) if is_job(file) else options.cell


def read_axis(text: str) -> tuple[str, tuple[float, float, int]]:
    """An axis with its range and number of places, from text such as 'x: 0 mm .. 90 mm, 10'.

    Args:
        text: The value of an option.

    Raises:
        InvalidInput: Another form, an unknown axis, or no such quantities.
    """
    from armcontour.errors import InvalidInput

    name, _, rest = text.partition(":")
    span, comma, count = rest.rpartition(",")
    low, dots, high = span.partition("..")
    if not (comma and dots) or not count.strip().isascii() or not _is_whole(count):
        raise InvalidInput(f"{OVER}, not {text!r}.")
    kind = _kind("--over", name.strip())
    option = f"--over {name.strip()}"
    ends = [read_option(option, x.strip(), kind) for x in (low, high)]
    assert ends[0] is not None and ends[1] is not None
    if ends[0] > ends[1]:
        raise InvalidInput(
            f"The range of {option} from {low.strip()} to {high.strip()} is empty: give the "
            "smaller value first."
        )
    return name.strip(), (ends[0], ends[1], int(count))


def _is_whole(text: str) -> bool:
    """Whether a text is a whole number of a few digits."""
    digits = text.strip().removeprefix("-")
    return digits.isdigit() and len(digits) <= 9


def _read_uncertainty(text: str) -> tuple[str, float]:
    """An axis and by how much the part may be off along it.

    Raises:
        InvalidInput: Another form, an unknown axis, or no such quantity.
    """
    from armcontour.errors import InvalidInput

    name, colon, size = (x.strip() for x in text.partition(":"))
    if not colon:
        raise InvalidInput(f"{OFF}, not {text!r}.")
    found = read_option(f"--uncertainty {name}", size, _kind("--uncertainty", name))
    assert found is not None
    return name, found


def _kind(option: str, name: str) -> object:
    """The kind of quantity of an axis.

    Raises:
        InvalidInput: There is no such axis.
    """
    from armcontour._quantities import Angle, Length
    from armcontour.errors import InvalidInput
    from armcontour.placement import UNITS

    if name not in UNITS:
        raise InvalidInput(f"{option} has no axis {name!r}: axes are {', '.join(UNITS)}.")
    return Length if UNITS[name] == "m" else Angle


def _read_about(text: str | None) -> str | tuple[float, ...] | None:
    """The point that is placed: its name, or its coordinates [m]; None without the option.

    Raises:
        InvalidInput: No such point.
    """
    from armcontour._quantities import Length

    if text is None or "," not in text:
        return text
    example = "400 mm, 0 mm, 0 mm"
    found = read_option_list("--about", text, Length, counts=(3,), example=example)
    assert found is not None
    return found


def _job_text(found: Placement, file: FilePath, out: FilePath, options: JobOptions) -> str:
    """The text of the job in its best place.

    Raises:
        InvalidInput: It cannot be written with keys of a job.
    """
    from armcontour.cli.opening import read_overrides
    from armcontour.io import placed_job_text
    from armcontour.io.cell import open_text

    named = _text_of(file, options)
    text, folder = open_text(str(named))
    return placed_job_text(
        found,
        text,
        folder=folder,
        to=out,
        drawing=None if named == str(file) else file,
        overrides=read_overrides(options),
    )


def _print(found: Placement, report: FilePath, job: FilePath | None, unwritten: str) -> None:
    """Print the best place, what it gains, and how places were refused."""
    from armcontour.core.render import compare, text
    from armcontour.core.result import TABLE

    console = Console()
    for line in text(found.to_data()).splitlines():
        console.say(line)
    header, *rows = compare(found.comparison, TABLE, texts=True)
    console.show_table(["", *header[1:]], rows)
    notes = [*found.notes, *found.job.arm.notes, *([unwritten] if unwritten else [])]
    for note in notes:
        console.say(f"Note: {note}")
    if job is not None:
        console.say(f"Job: {job}")
    console.say(f"Report: {report.as_uri()}")
