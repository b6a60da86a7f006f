"""Reads the CAD model of a document in a thread, and describes it for the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from threading import Thread
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.file_access import MAX_HAND_WRITTEN, read_bytes
from armcontour.core.frames import Frame
from armcontour.files.length_units import unit_length
from armcontour.files.model.cad_model import Model
from armcontour.files.model.edge_picking import EdgePicker, written_rule
from armcontour.files.model.edge_rules import MODELS, EdgeRule
from armcontour.files.model.edge_selection import fold_of
from armcontour.files.model.tool_axis import Bisector, FaceNormal
from armcontour.report.arm_frame import matrix
from armcontour.report.message_frame import MessageFrame
from armcontour.report.view import to_float32


@dataclass(frozen=True, slots=True)
class ModelSource:
    """What a model is read from.

    Args:
        file: The file.
        units: Unit of its lengths, as in `path.units`.
        state: Size [bytes] and time of the last change [ns] of the file; None if it is missing.
    """

    file: FilePath
    units: str | float | None
    state: tuple[int, int] | None

    @classmethod
    def of_path(cls, path: Any, folder: FilePath) -> ModelSource | None:
        """Return the source of the model of a path; None if the path is of another kind.

        - `path`: data of the key `path`.
        - `folder`: folder to which file names are relative.
        """
        if not isinstance(path, Mapping) or not is_model_file(path.get("file")):
            return None
        units = path.get("units")
        file = folder / path["file"]
        try:
            status = file.stat()
        except OSError:
            state = None
        else:
            state = (status.st_size, status.st_mtime_ns)
        return cls(file, units if isinstance(units, str | float | int) else None, state)

    def read(self) -> EdgePicker:
        """Read the model with its seams and triangles."""
        content = read_bytes(self.file, "file", maximum=MAX_HAND_WRITTEN)
        unit = unit_length(self.units)
        return Model(content, self.file.name, unit=unit, triangles=True).picker()


def is_model_file(file: Any) -> bool:
    """Return whether the value of `path.file` names a CAD model."""
    return isinstance(file, str) and FilePath(file).suffix.lower() in MODELS


@dataclass(frozen=True, slots=True, eq=False)
class ReadModel:
    """A model that was read, or why it could not be read.

    Args:
        source: What it was read from.
        picker: Its edges; None if it could not be read.
        frame: Message frame that shows it, or the reason.
    """

    source: ModelSource
    picker: EdgePicker | None
    frame: MessageFrame


class ModelReader:
    """Reads models in a thread, one at a time.

    Args:
        deliver: Function that is called in this thread with each model.
    """

    def __init__(self, deliver: Callable[[ReadModel], None]) -> None:
        self._deliver = deliver
        self._thread: Thread | None = None
        # Source of the newest request.
        self._source: ModelSource | None = None

    def request(self, source: ModelSource | None) -> None:
        """Read a model, unless it is the one that was requested last; None requests none."""
        if source == self._source:
            return
        self._source = source
        if source is not None:
            before = self._thread
            self._thread = Thread(target=self._read, args=(source, before), daemon=True)
            self._thread.start()

    def is_current(self, source: ModelSource) -> bool:
        """Return whether a source is that of the newest request."""
        return source == self._source

    def wait(self) -> None:
        """Wait until the requested model was delivered."""
        if self._thread is not None:
            self._thread.join()

    def _read(self, source: ModelSource, before: Thread | None) -> None:
        """Read and deliver a model after the thread `before` has ended."""
        if before is not None:
            before.join()
        if not self.is_current(source):
            return
        try:
            picker = source.read()
            read = ReadModel(source, picker, model_frame(picker))
        except ArmContourError as error:
            read = ReadModel(source, None, MessageFrame("model", {"sentence": str(error)}))
        self._deliver(read)


def model_frame(picker: EdgePicker) -> MessageFrame:
    """Make the message frame `model`: triangles of the parts, and polylines of the edges.

    All coordinates are those of the file [m].
    """
    tables = picker.tables
    points = [picker.points(i) for i in picker.edges]
    named = zip(picker.names, tables.parts, strict=True)
    solids = {name: x for name, x in named if len(x.triangles)}
    header = {
        "source": picker.source,
        "parts": list(solids),
        "edges": [_edge_header(picker, i) for i in picker.edges],
        "groups": [
            {"rule": rule_text(x.rule), "edges": [picker.edges.index(i) for i in x.edges]}
            for x in picker.groups
        ],
        "sentence": None,
    }
    corners = [x.points[x.triangles].reshape(-1, 3) for x in solids.values()]
    arrays = {
        "points": to_float32(np.concatenate(points) if points else np.empty((0, 3))),
        "breaks": _breaks(points),
        "triangles": to_float32(np.concatenate(corners) if corners else np.empty((0, 3))),
        "part_breaks": _breaks(corners),
    }
    return MessageFrame("model", header, arrays)


def _edge_header(picker: EdgePicker, index: int) -> dict[str, Any]:
    """Describe an edge for the page: kind, fold, sizes [m], and whether it can be picked."""
    edge = picker.tables.edges[index]
    return {
        "kind": edge.kind,
        "fold": fold_of(edge),
        "length": edge.length,
        "radius": edge.radius,
        "seam": edge.seam,
        "group": picker.group_of[index],
        "covered": index in picker.covered,
    }


def _breaks(pieces: Sequence[FloatArray]) -> Any:
    """Return where pieces of a joined array begin, and its end, (n + 1,)."""
    return np.cumsum([0, *map(len, pieces)]).astype(np.uint32)


def rule_text(rule: EdgeRule) -> str:
    """Return a rule as it is written in a job file, on one line."""
    rows = []
    for name, value in written_rule(rule).items():
        text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
        rows.append(f"{name}: {text}")
    return ", ".join(rows)


def selection_header(
    picker: EdgePicker | None,
    rules: Sequence[EdgeRule] | None,
    frame: Frame,
    scale: float,
    axis: Bisector | None,
) -> dict[str, Any]:
    """Describe where a model is in the frame of the path, and which edges are selected.

    Args:
        picker: Edges of the model; None if it is not read yet.
        rules: Rules of the job; None if its path has an empty list of rules.
        frame: Frame of the part.
        scale: Factor for all lengths in the file.
        axis: Tool axis; None if it does not follow the faces at the edges.
    """
    selected: list[tuple[int, int]] = []
    if picker is not None and rules is not None:
        try:
            numbers = picker.select(rules)
        except InvalidInput:
            # The refusal of the job states this error.
            numbers = {}
        places = {index: k for k, index in enumerate(picker.edges)}
        selected = [(places[i], number) for i, number in numbers.items() if i in places]
    pose = matrix(frame) @ np.diag([scale, scale, scale, 1.0])
    texts = [] if rules is None else [rule_text(x) for x in rules]
    return {"at": pose, "selected": selected, "rules": texts, "axis": _axis_header(axis)}


def _axis_header(axis: Bisector | None) -> dict[str, Any] | None:
    """Describe a tool axis: its key in `path.orientation`, and its angles [degrees]."""
    if axis is None:
        return None
    form = "face" if isinstance(axis, FaceNormal) else "bisector"
    angles = {x: round(float(np.degrees(getattr(axis, x))), 6) for x in ("work", "travel")}
    return {"form": form, **angles}
