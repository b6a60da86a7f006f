"""Start page: templates of new jobs (cards), pictures of the arms, and recent files."""

from __future__ import annotations

import json
import secrets
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.staging import write_atomically
from armcontour.files.cell import cell_names, cell_text, read_cell_arm
from armcontour.files.patch import Patch, write_patch
from armcontour.robot import SerialArm
from armcontour.robot.chain import link_poses
from armcontour.studio.arm_picture import triangles_of
from armcontour.studio.document import Document
from armcontour.studio.drafts import Draft, all_drafts, draft_file, make_private, state_folder
from armcontour.studio.page_frame import PageFrame
from armcontour.studio.uploads import Uploads

# Drawings that cards open, by card. The other cards open the job of the paper or an empty plane.
DRAWINGS = {"drawing": "plate.svg", "gcode": "slot.ngc", "weld": "seam.svg"}
PAPER, EMPTY = "paper", "empty"
WEAVE = {"width": "4 mm", "frequency": "2 Hz", "speed": "6 mm/s"}
# Maximum number of recent files.
MAX_RECENT = 8
# Rotation of a tool that points down.
DOWN = np.diag([1.0, -1.0, -1.0])


def new_document(card: str, arm: str, uploads: Uploads, before: Document) -> Document:
    """Create the job for a card of the start page, in the folder of the open document `before`."""
    checks.check_choice("card", card, (*DRAWINGS, PAPER, EMPTY))
    folder, library = before.folder, resources.files("armcontour.jobs.library")
    if card == PAPER:
        text = (library / "paper.yaml").read_text(encoding="utf-8")
        return Document.of_text(text, folder, "paper.yaml", "built-in", upload=True)
    if card == EMPTY:
        return blank_document(arm, folder, f"new {secrets.token_hex(8)}")
    name = DRAWINGS[card]
    document = uploads.open(name, (library / name).read_bytes(), arm, before)
    assert isinstance(document, Document)
    if card != "weld":
        return document
    text = write_patch(document.text, {("process", "weave"): WEAVE})
    return Document.of_text(text, folder, document.source, document.key, upload=True)


def blank_document(arm: str, folder: FilePath, key: str) -> Document:
    """Create a job with an empty path in a built-in cell."""
    names: Patch = {("name",): "untitled", ("title",): f"New job on {arm}"}
    text = write_patch(cell_text(arm), names)
    return Document.of_text(text, folder, "untitled.yaml", key, upload=True)


def start_frame() -> PageFrame:
    """Message frame with the contents of the start page: arms and recent files."""
    shown = [
        {"id": id, "name": x["name"], "where": x["where"]} for id, x in _recent_entries().items()
    ]
    return PageFrame("start", {"arms": arm_pictures(), "recent": shown})


@cache
def arm_pictures() -> list[dict[str, Any]]:
    """Name and silhouette (SVG path and view box) of the arm of each built-in cell."""
    return [{"name": name, **_draw_arm(name)} for name in cell_names()]


def _draw_arm(name: str) -> dict[str, Any]:
    """Silhouette of an arm that reaches forward, seen from the side; of a planar arm from above."""
    from scipy.spatial import ConvexHull

    arm: Any = read_cell_arm(name)
    ends = [*arm.chain.positions, (arm.chain.tip @ arm.chain.tool).position]
    reach = sum(float(np.linalg.norm(x)) for x in ends)
    aim, up = Frame(position=reach * np.array([0.55, 0.1, 0.0])), 1
    if isinstance(arm, SerialArm):
        aim, up = Frame(position=reach * np.array([0.45, 0.0, 0.15]), rotation=DOWN), 2
    poses = link_poses(arm.chain, arm.inverse(aim, all=True))
    # The configuration whose links are highest has the elbow up.
    pose = poses[np.argmax(poses[:, :, up, 3].sum(axis=1))]
    outlines = []
    for link_shape in arm.shapes.shapes:
        points = triangles_of(link_shape.exact or link_shape.shape).reshape(-1, 3)
        points = points @ link_shape.place.rotation.T + link_shape.place.position
        projected = (points @ pose[link_shape.link, :, :3].T + pose[link_shape.link, :, 3])[
            :, [0, up]
        ] * [1e3, -1e3]
        outlines.append(projected[ConvexHull(projected).vertices].round().astype(int))
    low, high = (f(np.concatenate(outlines), axis=0) for f in (np.min, np.max))
    shape = "".join(f"M{'L'.join(f'{x},{y}' for x, y in outline)}Z" for outline in outlines)
    return {"shape": shape, "box": " ".join(map(str, [*low, *(high - low)]))}


# Recent files


def open_file(file: FilePath, cell: str | None) -> Document:
    """Open a job file, or a drawing in a cell, and add it to the recent files."""
    document = Document.open(file) if cell is None else Document.of_drawing(file, cell)
    add_recent(file, cell)
    return document


def add_recent(file: FilePath, cell: str | None) -> None:
    """Put a file at the beginning of the list of recent files."""
    entry = {"file": str(file.absolute()), "cell": cell}
    content = json.dumps([entry, *(x for x in _read_recent() if x != entry)][:MAX_RECENT]).encode()
    with suppress(InvalidInput, OSError):
        make_private(state_folder())
        write_atomically(state_folder() / "recent.json", lambda fresh: fresh.write_bytes(content))


def _read_recent() -> list[dict[str, Any]]:
    """Recent files, newest first."""
    try:
        entries = json.loads((state_folder() / "recent.json").read_bytes())
        return [{"file": str(x["file"]), "cell": x["cell"]} for x in entries]
    except (OSError, ValueError, TypeError, KeyError):
        return []


def _recent_entries() -> dict[str, dict[str, Any]]:
    """Recent entries of the start page by identity: drafts of uploads, then existing files."""
    entries: dict[str, dict[str, Any]] = {
        draft_file(x.key).stem: {"name": x.name, "where": "not saved", "draft": x}
        for x in all_drafts()
        if x.upload and not Draft.is_foreign(x.key)
    }
    for file_entry in _read_recent():
        file, cell = FilePath(file_entry["file"]), file_entry["cell"]
        if file.is_file():
            where = str(file.parent) if cell is None else f"{file.parent}, on {cell}"
            entries[draft_file(str(file_entry)).stem] = {
                "name": file.name,
                "where": where,
                **file_entry,
            }
    return entries


def find_recent(identity: str) -> Mapping[str, Any]:
    """Recent entry with an identity; the entry has a draft, or a file and its cell."""
    entry = _recent_entries().get(identity)
    if entry is None:
        raise InvalidInput("This recent file or draft no longer exists.")
    return entry
