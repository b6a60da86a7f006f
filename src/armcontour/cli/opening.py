"""Open the job that a command is given: a job file, or a drawing and a cell."""

from __future__ import annotations

from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.quantities import read_option, read_option_list

if TYPE_CHECKING:
    from armcontour._progress import Progress
    from armcontour.cli.options import JobOptions
    from armcontour.io.job_overrides import JobOverrides
    from armcontour.jobs import Job

# A job may have one of these endings, or none.
JOBS = (".yaml", ".yml", "")
# Name of the built-in job, which any command takes in place of a job file.
PAPER = "paper"


def read_overrides(x: JobOptions) -> JobOverrides:
    """Read options that replace values of a job.

    Args:
        x: The options as text.

    Raises:
        InvalidInput: Text that is no quantity of the required unit.
    """
    from armcontour import _checks
    from armcontour import _quantities as kinds
    from armcontour.io.job_overrides import JobOverrides

    place = read_option_list(
        "--at", x.at, kinds.Length, counts=(2, 3), example="300 mm, 0 mm, 100 mm"
    )
    turn = read_option_list("--turn", x.turn, kinds.Angle, counts=(3,), example="0, 0, 90 deg")
    return JobOverrides(
        units=x.units,
        columns=x.waypoint_columns,
        scale=None if x.scale is None else _checks.positive("--scale", x.scale),
        position=None if place is None else (*place, 0.0)[:3],
        turn=turn,
        layers=tuple(x.layer) if x.layer else None,
        names=None if x.contour is None else tuple(x.contour),
        colors=tuple(x.color) if x.color else None,
        flat=x.flat,
        texts=x.texts,
        skip_unknown=x.skip_unknown,
        skip_words=split_words(x.skip),
        tools=read_tools(x.tool),
        tool=x.only_tool,
        speed=read_option("--speed", x.speed, kinds.Speed),
        corner_tolerance=read_option("--tolerance", x.tolerance, kinds.Distance),
        corner_shape=x.corner_shape,
        line_tolerance=read_option("--line-tolerance", x.line_tolerance, kinds.Distance),
        zone=read_option("--zone", x.zone, kinds.Tolerance),
        iterations=x.iterations,
        continuity=x.continuity,
        from_s=read_option("--from-s", x.from_s, kinds.Distance),
        ignore_collisions=x.ignore_collisions,
    )


def library_file(name: str) -> FilePath:
    """A file of the package's library of jobs."""
    return FilePath(str(resources.files("armcontour.jobs") / "library" / name))


def is_job(file: FilePath) -> bool:
    """Whether a file is a job by its name; else it is a drawing."""
    from armcontour.errors import InvalidInput

    if file.is_dir():
        raise InvalidInput(f"{file} is a folder: name a job file or a drawing.")
    return file.suffix.lower() in JOBS


def open_job(
    file: FilePath, x: JobOptions, progress: Progress, overrides: JobOverrides | None = None
) -> Job:
    """Read the job in a job file, or combine a drawing with a cell.

    Args:
        file: A job file, or a drawing.
        x: Options that replace values of the job; --cell is for a drawing only.
        progress: Called with the progress of reading the drawing.
        overrides: Values to replace; by default those of the options.

    Raises:
        InvalidInput: A drawing without a cell, a job file with a cell, or an invalid file.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io import read_job
    from armcontour.io.cell import cell_names, read_cell
    from armcontour.io.drawings.endings import find_reader

    overrides = read_overrides(x) if overrides is None else overrides
    if is_job(file):
        if x.cell is not None:
            raise InvalidInput(
                f"{file.name} is a job, which has an arm: --cell goes with a drawing."
            )
        if str(file) == PAPER and not file.exists():
            file = library_file("paper.yaml")
        return read_job(file, overrides=overrides, reading=progress, trust_xacro=x.trust_xacro)
    # A robot description, say, is no drawing, and needs no cell.
    find_reader(file)
    if x.cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing: name the cell it is to be run in with --cell, one of "
            f"{', '.join(cell_names())}, or a job file."
        )
    return read_cell(x.cell, file, overrides=overrides, reading=progress, trust_xacro=x.trust_xacro)


def split_words(given: list[str] | None) -> tuple[str, ...] | None:
    """Words separated by commas, in one option or several; None without the option."""
    if given is None:
        return None
    return tuple(x.strip() for text in given for x in text.split(",") if x.strip())


def read_tools(given: list[str] | None) -> dict[int, float] | None:
    """Diameters of tools by their numbers, from options such as '1: 3 mm'; None without any.

    Raises:
        InvalidInput: Text of another form, or a tool twice.
    """
    from armcontour import _quantities as kinds
    from armcontour.errors import InvalidInput

    if given is None:
        return None
    found: dict[int, float] = {}
    for text in (part for x in given for part in x.split(",")):
        number, colon, diameter = (x.strip() for x in text.partition(":"))
        if not (colon and number.isascii() and number.isdigit() and len(number) <= 8):
            raise InvalidInput(
                f"--tool takes the number and the diameter of a tool, such as '1: 3 mm', not "
                f"{text!r}."
            )
        if int(number) in found:
            raise InvalidInput(f"--tool gives the tool {number} twice: give one diameter.")
        length = read_option("--tool", diameter, kinds.Length)
        assert length is not None
        found[int(number)] = length
    return found
