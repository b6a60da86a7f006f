"""No number in a job breaks the program: what is decided before work starts, in all fields.

`make soak` runs all of them to their end.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import pytest
import yaml
from soak.number_cases import (
    FILES,
    HOSTILE,
    NEVER,
    base_of,
    fields,
    numeric_options,
    put,
    shown,
)

from armcontour import ArmContourError
from armcontour.io import parse_job

FIELDS = fields()
# libyaml's writer, ten times as fast, where PyYAML has it.
DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
# Half a million arcs are made before that is refused.
SLOW = [("path.spline.points.0.0", "1e9")]


# Refusals that need not say the key: they name the file, the run, or the option that is a key too.
WITHOUT_KEY = (
    "job: Run one: At its assigned velocities",
    "robot.urdf takes no arguments",
    "part.svg",
    "job: scale must",
    "job: Segment 3 starts at (40000000.0",
    "job: chord tolerance must be at least 1e-30",
    "job: join tolerance must be at least 1e-30",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the files lie that jobs name."""
    found = tmp_path_factory.mktemp("numbers")
    for name, data in FILES.items():
        (found / name).write_bytes(data)
    return found


def read(job: dict[str, Any], folder: Path) -> str | None:
    """The sentence that a job is refused with; None if it is read."""
    try:
        # Of a library's warnings, pytest makes errors.
        parse_job(yaml.dump(job, Dumper=DUMPER), folder=folder)
    except ArmContourError as error:
        return str(error)
    return None


def test_the_schema_has_its_numbers() -> None:
    assert len(FIELDS) >= 142
    for place in [("servo", "kp"), ("servo", "kp", 0), ("runs", "*", "timing", "intervals")]:
        assert place in FIELDS


@pytest.mark.parametrize("place", FIELDS, ids=shown)
def test_a_number_is_read_or_refused_with_one_sentence(
    place: tuple[str | int, ...], folder: Path
) -> None:
    base = base_of(place)
    assert (read(base, folder) is None) == (place not in NEVER)
    for word, value in HOSTILE.items():
        if (shown(place), word) in SLOW:
            continue
        said = read(put(base, place, value), folder)
        if said is not None:
            assert "\n" not in said, word
            key = re.search(rf"\b{place[0]}[.: ]", said)
            assert key or any(x in said for x in WITHOUT_KEY), said
        # What is no finite number is refused in any field, but for text where that may stand.
        if word in ("nan", "inf", "-inf"):
            assert said is not None, word


def test_options_that_take_numbers_are_found() -> None:
    found = {(command, option) for command, option, _ in numeric_options()}
    assert found >= {("run", "--speed"), ("run", "--memory"), ("identify", "--to")}


def test_warnings_are_errors_here() -> None:
    with pytest.raises(RuntimeWarning):
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
