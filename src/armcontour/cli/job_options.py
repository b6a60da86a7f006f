"""Options that set keys of a job, by their topics in the help.

The option `--set` sets any key. The options here are for the keys that are set most often.
`tests/cli/test_options.py` compares this table with the keys of a job.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, TypeAlias

from armcontour.core.text import plain_number

# Type of the value that typer reads: bool for a flag, list[str] for an option that may be repeated.
Kind: TypeAlias = type[str] | type[list[str]] | type[bool] | type[float] | type[int]


def to_quantity(text: str) -> str | int:
    """Convert text to a quantity as in a job file: text with a unit, or 0."""
    return 0 if plain_number(text) == 0 else text.strip()


def to_quantities(text: str) -> list[str | int]:
    """Convert text to a list of quantities, which commas separate."""
    return [to_quantity(part) for part in text.split(",")]


def to_names(text: str) -> list[str]:
    """Convert text to a list of names, which commas separate."""
    return [part.strip() for part in text.split(",")]


def to_mapping(text: str) -> Any:
    """Convert text to the value that it is in a job file."""
    from armcontour.core.yaml_loader import load

    return load(text, "the option")


def to_skip(_: bool) -> str:
    """Convert a flag to "skip", the value of the job key for unknown elements."""
    return "skip"


def to_formats(texts: list[str]) -> list[str]:
    """Resolve templates against the working folder, because in a job the job's folder counts."""
    return [str(FilePath(x).absolute()) if x.endswith(".j2") else x for x in texts]


# Options and topics are neither compared nor printed. Without these methods, commands start sooner.
@dataclass(frozen=True, eq=False, repr=False)
class JobOption:
    """An option that sets a key of a job.

    Args:
        name: Name of the option, such as "--point-tolerance".
        key: Key path, joined by dots.
        help: Text in the help.
        kind: Type of the value on the command line.
        read: Converts this value to the value of the key; None if they are equal.
        least: Smallest value of a whole number.
    """

    name: str
    key: str
    help: str
    kind: Kind = str
    read: Callable[[Any], Any] | None = None
    least: int | None = None

    @property
    def parameter(self) -> str:
        """Name of the option as a parameter of a function, such as "point_tolerance"."""
        return self.name.removeprefix("--").replace("-", "_")


@dataclass(frozen=True, eq=False, repr=False)
class Topic:
    """A section of the help, with its options."""

    title: str
    options: tuple[JobOption, ...]


SPEED = Topic(
    "Speed, corners and start",
    (
        JobOption(
            "--speed",
            "limits.speed",
            "Assigned velocity: requested tool speed, which is not exceeded, such as '0.15 m/s'.",
            read=to_quantity,
        ),
        JobOption(
            "--corner-shape",
            "corners.shape",
            '"arc" rounds corners with arcs; "free" finds, for the limits of the run, the fastest '
            "path whose points are all within the tolerance of the objective, at corners and along "
            "lines, and requires tolerance and the timing optimal.",
        ),
        JobOption(
            "--tolerance",
            "corners.tolerance",
            "Largest corner error (case II), such as '5 mm'.",
            read=to_quantity,
        ),
        JobOption(
            "--resume-at",
            "process.resume_at",
            "Arc length at which to resume the program, over all contours from their start points, "
            "with overlaps and without leads or rounding, such as '5 mm'.",
            read=to_quantity,
        ),
        JobOption(
            "--rejoin",
            "process.rejoin",
            "Length before --resume-at that is processed again, not beyond the start of the "
            "contour, such as '3 mm'.",
            read=to_quantity,
        ),
        JobOption(
            "--only",
            "process.only",
            "Contours that are executed, in the order of the whole job: names, numbers from 1, or "
            "layers, such as 'CUT, 3'.",
            read=to_names,
        ),
    ),
)
FIRST_RUN = Topic(
    "First run on the robot",
    (
        JobOption(
            "--speed-factor",
            "speed_factor",
            "Fraction of the planned speed, for a first, slow run on the robot: contours, rapids "
            "and everything else along the same joint path, such as '10 %'; by default 100 %. For "
            "armcontour play it is the speed at the start, by default 10 %.",
            read=to_quantity,
        ),
        JobOption(
            "--process-off",
            "process.off",
            "Whether the process stays off, for a first run on the robot: the tool moves along the "
            "same path, but no output is switched, no analog output has a value, and pierces take "
            "no time.",
            kind=bool,
        ),
        JobOption(
            "--lift",
            "process.lift",
            "Distance of the tool above the part, along its z axis, for a first run on the robot "
            "with --process-off, such as '20 mm'.",
            read=to_quantity,
        ),
    ),
)
DRAWING = Topic(
    "Drawing",
    (
        JobOption(
            "--units",
            "path.units",
            'Unit of the lengths in the file, such as "mm", or the length of the unit in metres.',
        ),
        JobOption(
            "--scale",
            "path.scale",
            "Factor for all lengths in the file.",
            kind=float,
        ),
        JobOption(
            "--layer",
            "path.layers",
            "Layers to read, or a mapping from layers to the speed and tolerance of their "
            "contours, for segments that have none; may be repeated.",
            kind=list[str],
        ),
        JobOption(
            "--contour",
            "path.names",
            'Names of contours to read: ids of elements (SVG), "CUT-3" for the third contour of '
            'the layer CUT (DXF), "line 12" (G-code); may be repeated.',
            kind=list[str],
        ),
        JobOption(
            "--ignore-z",
            "path.ignore_z",
            "Ignore z and the tool orientation in the file.",
            kind=bool,
        ),
        JobOption(
            "--waypoint-columns",
            "path.columns",
            'For waypoints in CSV, names of the columns, such as "x [mm],y [mm],-".',
        ),
        JobOption(
            "--arc-turns",
            "path.arc_turns",
            "For G-code, the meaning of the word P of an arc: total (LinuxCNC, FluidNC), or extra "
            "full circles before the arc (Marlin).",
        ),
        JobOption(
            "--skip-unknown",
            "path.unknown",
            "Skip unknown elements.",
            kind=bool,
            read=to_skip,
        ),
    ),
)
MODEL = Topic(
    "Edges of a CAD model",
    (
        JobOption(
            "--edges",
            "path.edges",
            "Edges that become contours: one rule, or a list of rules whose union is read, such as "
            "'{seams: [post, plate], open: 200 mm}'.",
            read=to_mapping,
        ),
        JobOption(
            "--orientation",
            "path.orientation",
            "Tool orientation, such as '{bisector: {travel: -10 deg}}'; by default the bisector of "
            "the faces at an edge.",
            read=to_mapping,
        ),
    ),
)
POSITION = Topic(
    "Cell and position of the drawing",
    (
        JobOption(
            "--position",
            "path.frame.position",
            "Origin of the drawing: '300 mm, 0 mm, 100 mm'; without the third length, z stays.",
            read=to_quantities,
        ),
        JobOption(
            "--rpy",
            "path.frame.rpy",
            "Roll, pitch, yaw: '0, 0, 90 deg'.",
            read=to_quantities,
        ),
    ),
)
CERTIFICATE = Topic(
    "Certificate",
    (
        JobOption(
            "--total-tolerance",
            "certificate.tolerance",
            "Largest distance of the tool from the objective path, such as '0.2 mm'.",
            read=to_quantity,
        ),
        JobOption(
            "--servo-error",
            "certificate.servo_error",
            "Largest contour error from servo and cycle, for every robot of the box if there is "
            "one, such as '0.2 mm'.",
            read=to_quantity,
        ),
    ),
)
EXPORTS = Topic(
    "Files for robot controllers",
    (
        JobOption(
            "--export",
            "export.formats",
            "Formats: csv, ros-yaml, urscript, mcap, kuka, abb, or a template such as house.j2; "
            "may be repeated.",
            kind=list[str],
            read=to_formats,
        ),
        JobOption(
            "--tolerances",
            "export.tolerances",
            "With ros-yaml, ratio of the tolerances of a FollowJointTrajectory goal to the "
            "predicted joint errors, at least 1; by default no goal.",
            kind=float,
        ),
    ),
)
EXPORTED_POINTS = Topic(
    "Points of these files",
    (
        JobOption(
            "--cycle",
            "export.cycle",
            "Time between points of the plan, such as '4 ms'; by default the cycle of the run, and "
            "for kuka and abb the longest with which the controller stays near the path.",
            read=to_quantity,
        ),
        JobOption(
            "--derivatives",
            "export.derivatives",
            "Highest derivative of the positions: 2, 1 or 0; by default 2, or 0 for set-points "
            "with command limits.",
            kind=int,
            least=0,
        ),
        JobOption(
            "--points",
            "export.points",
            "With ros-yaml, largest number of points.",
            kind=int,
            least=2,
        ),
        JobOption(
            "--point-tolerance",
            "export.point_tolerance",
            "With points, largest difference that fewer points cause at any joint, such as '0.1 "
            "mrad'.",
            read=to_quantity,
        ),
        JobOption(
            "--call",
            "export.call",
            "With urscript, whether the program is called at the end of its file, for the script "
            "file of a pendant.",
            kind=bool,
        ),
    ),
)
TOPICS = (SPEED, FIRST_RUN, DRAWING, MODEL, POSITION, CERTIFICATE, EXPORTS, EXPORTED_POINTS)
# All options by the names of their parameters.
JOB_OPTIONS = {x.parameter: x for topic in TOPICS for x in topic.options}
