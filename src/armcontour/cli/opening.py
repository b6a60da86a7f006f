"""What `armcontour run` is given: a job file, or a drawing and a cell to put it in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armcontour.jobs import Job

Told = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrides:
    """What the command line says of a job in the place of its file; None says nothing.

    Args:
        units: Of the drawing's lengths.
        scale: Factor of them.
        at: Where the drawing's origin lies, such as "0.3, 0.1, 0.2" or "300 mm, 100 mm".
        turn: Roll, pitch and yaw of the drawing, such as "0, 0, 90 deg".
        layers: Layers to run.
        names: Contours to run.
        flat: Leave z out.
        skip: Skip what the reader does not know.
        skip_words: Words and codes of G-code to leave out, such as "T,M6".
        speed: Assigned velocity where the drawing gives none, of runs with one of their own too.
        tolerance: Largest corner error where the drawing gives none, of runs with one of their own
            too; runs without rounding keep sharp corners.
        from_s: Where to resume.
        memory: What the program may take.
    """

    units: str | None = None
    scale: float | None = None
    at: str | None = None
    turn: str | None = None
    layers: list[str] | None = None
    names: list[str] | None = None
    flat: bool = False
    skip: bool = False
    skip_words: list[str] | None = None
    speed: str | None = None
    tolerance: str | None = None
    from_s: str | None = None
    memory: str | None = None


def open_job(
    file: FilePath,
    cell: str | None,
    overrides: Overrides,
    told: Told,
    *,
    trust_xacro: bool = False,
) -> Job:
    """The job in a job file, or of a drawing in a cell.

    Args:
        file: A job file, or a drawing.
        cell: The cell, for a drawing only.
        overrides: What the command line says.
        told: Called with the share of the drawing that is read.
        trust_xacro: Whether the arm may be a .xacro file, which is a program.

    Raises:
        InvalidInput: A drawing without a cell, a job file with one, or what reading finds.
    """
    from armcontour.errors import InvalidInput
    from armcontour.io import parse_job
    from armcontour.io.cell import YAML, cell_names, read_cell
    from armcontour.io.job_file import job_text

    def changes(data: dict[str, Any]) -> dict[str, Any]:
        return apply_overrides(data, overrides)

    if file.suffix.lower() in YAML or not file.suffix:
        if cell is not None:
            raise InvalidInput(
                f"{file.name} is a job, which has an arm: --cell goes with a drawing."
            )
        text = job_text(file)
        return parse_job(
            text,
            source=file.name,
            folder=file.parent,
            changes=changes,
            reading=told,
            trust_xacro=trust_xacro,
        )
    if cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing: name the cell it is to be run in with --cell, one of "
            f"{', '.join(cell_names())}, or a job file."
        )
    return read_cell(cell, file, changes=changes, reading=told, trust_xacro=trust_xacro)


def apply_overrides(data: dict[str, Any], x: Overrides) -> dict[str, Any]:
    """A job's data, with the values from the command line in place of its own."""
    path = _merged(data.get("path"), _path_keys(x, data.get("path")))
    found = {**data, "path": path} if path is not None else dict(data)
    if x.speed is not None:
        found["limits"] = _merged(data.get("limits"), {"speed": _quantity(x.speed)})
    if x.tolerance is not None:
        corners = data.get("corners")
        old = corners if isinstance(corners, dict) else {}
        found["corners"] = {**old, "tolerance": _quantity(x.tolerance)}
    found |= _changed_runs(data, x)
    if x.from_s is not None:
        found["process"] = _merged(data.get("process"), {"from_s": _quantity(x.from_s)})
    if x.memory is not None:
        found["memory"] = _quantity(x.memory)
    return found


def _changed_runs(data: dict[str, Any], x: Overrides) -> dict[str, Any]:
    """The runs of a job without speeds and tolerances of their own where the command line has one.

    What is no mapping is left for the reader of jobs to refuse.
    """
    runs = data.get("runs")
    if not isinstance(runs, dict):
        return {}
    overridden = [("limits", "speed", x.speed), ("corners", "tolerance", x.tolerance)]
    changed = {}
    for name, run in runs.items():
        found = run
        for part, key, text in overridden:
            own = found.get(part) if isinstance(found, dict) else None
            if text is not None and isinstance(own, dict) and key in own:
                found = {**found, part: {**own, key: _quantity(text)}}
        changed[name] = found
    return {"runs": changed}


def _words(given: list[str]) -> list[str]:
    """Words that are separated by commas, or given by several options."""
    return [x.strip() for text in given for x in text.split(",") if x.strip()]


def _path_keys(x: Overrides, path: Any) -> dict[str, Any]:
    keys: dict[str, Any] = {
        "units": x.units,
        "scale": x.scale,
        "names": x.names,
        "flat": x.flat or None,
        "unknown": {"skip": _words(x.skip_words)} if x.skip_words else "skip" if x.skip else None,
    }
    if x.layers:
        own = path.get("layers") if isinstance(path, dict) else None
        known = own if isinstance(own, dict) else {}
        keys["layers"] = {name: known.get(name, {}) for name in x.layers}
    frame: dict[str, list[float | str]] = {}
    if x.at is not None:
        position = _quantities("--at", x.at, (2, 3), "300 mm, 0 mm, 100 mm")
        frame["position"] = [*position, 0.0][:3]
    if x.turn is not None:
        frame["rpy"] = _quantities("--turn", x.turn, (3,), "0, 0, 90 deg")
    if frame:
        own = path.get("frame") if isinstance(path, dict) else None
        keys["frame"] = _merged(own, frame)
    return {key: value for key, value in keys.items() if value is not None}


def _merged(old: Any, new: dict[str, Any]) -> Any:
    """New keys over old ones; what is no mapping is left for the reader of jobs to refuse."""
    if old is None:
        return new or None
    return {**old, **new} if isinstance(old, dict) else old


def _quantities(option: str, text: str, counts: tuple[int, ...], example: str) -> list[float | str]:
    """Quantities with commas between.

    Raises:
        InvalidInput: More or fewer than there should be.
    """
    from armcontour.errors import InvalidInput

    parts = text.split(",")
    if len(parts) not in counts:
        wanted = " or ".join(str(n) for n in counts)
        raise InvalidInput(f"{option} takes {wanted} values, such as '{example}', not {text!r}.")
    return [_quantity(part) for part in parts]


def _quantity(text: str) -> float | str:
    """A plain number in SI, or text with a unit for the reader of jobs to understand."""
    from armcontour._numbers import parse_number

    try:
        return parse_number(text)
    except ValueError:
        return text.strip()
