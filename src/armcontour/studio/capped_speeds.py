"""Speeds of contours and layers that are not reached, because the job's speed is lower."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from armcontour.core.quantities import Quantity, read_plain, write_like
from armcontour.core.render import number
from armcontour.core.text import Keys
from armcontour.files.file_keys import quantity_of
from armcontour.files.job_model import JobModel
from armcontour.files.job_patch import locate_key
from armcontour.files.job_text_edits import value_at
from armcontour.jobs import Job
from armcontour.studio.edits.keys import run_of

# Key of the largest assigned velocity.
SPEED_LIMIT = ("limits", "speed")
# Keys of the path with speeds by name of a contour or layer.
OWN_SPEEDS = ("contours", "layers")


def capped_speeds(data: Mapping[str, Any], job: Job, run: str) -> dict[str, dict[str, Any]]:
    """Return the speeds of contours and layers above that of a run, by key.

    Each has a `sentence`, and `raised`: the speed of the job at which it is reached, as it is
    written in the job, and as `text`.
    """
    limit = run_of(job, run).limits.speed
    kind = quantity_of(JobModel, SPEED_LIMIT)
    if limit is None or kind is None:
        return {}
    written = value_at(data, locate_key(SPEED_LIMIT, data, run))
    rows = dict[str, dict[str, Any]]()
    for keys, speed in _own_speeds(data, kind):
        if speed <= limit:
            continue
        sentence = (
            f"Not reached: the speed of the job, {number(limit, 'm/s')}, is lower and applies to "
            "all contours."
        )
        raised = write_like(speed, written, kind)
        row = {"sentence": sentence, "raised": raised, "text": number(speed, "m/s")}
        rows[".".join(map(str, keys))] = row
    return rows


def _own_speeds(data: Mapping[str, Any], kind: Quantity) -> Iterator[tuple[Keys, float]]:
    """Yield the key and speed [m/s] of each contour and layer that has its own speed."""
    for group in OWN_SPEEDS:
        listed = value_at(data, ("path", group))
        for name, values in listed.items() if isinstance(listed, Mapping) else ():
            speed = values.get("speed") if isinstance(values, Mapping) else None
            if speed is not None:
                yield ("path", group, name, "speed"), read_plain(speed, kind)
