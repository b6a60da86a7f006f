"""A path hundreds of metres away: the key whose unit is missing, and a value that works there."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import pytest
import yaml
from soak.number_cases import PLANE, SPACE

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs import teach

POINTS = [[0.30, 0.20], [0.34, 0.20]]
IN_SPACE = SPACE["path"]


def framed(*position: float) -> dict[str, Any]:
    return PLANE | {"path": {"points": POINTS, "frame": {"position": list(position)}}}


CASES = {
    "frame": (framed(300, 0, 0), "path.frame.position is [300, 0, 0] m", "[300 mm, 0, 0]"),
    "point": (
        PLANE | {"path": {"points": [*POINTS, [310, 0.2]]}},
        "path.points (item 3) is [310, 0.2] m",
        "[310 mm, 200 mm]",
    ),
    "segment": (
        PLANE | {"path": {"start": [0.3, 0.2], "segments": [{"to": [310, 200]}]}},
        "path.segments (item 1).to is [310, 200] m",
        "[310 mm, 200 mm]",
    ),
    "work": (
        SPACE | {"arm": {"name": "ur5e", "work": {"position": [0, 0, 300]}}, "start": None},
        "arm.work.position is [0, 0, 300] m",
        "[0, 0, 300 mm]",
    ),
    "tool": (
        SPACE | {"arm": {"name": "ur5e", "tool": {"position": [0, 0, 100]}}, "start": None},
        "arm.tool.position is [0, 0, 100] m",
        "[0, 0, 100 mm]",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_key_that_lacks_its_unit_is_named(name: str) -> None:
    job, key, mend = CASES[name]
    with pytest.raises(ac.Unreachable) as caught:
        teach(parse_job(yaml.safe_dump(job | {"corners": "sharp"})))
    assert key in str(caught.value) and f"write {mend}." in str(caught.value)
    assert "units: mm" not in str(caught.value)


def test_a_drawing_is_given_its_unit(tmp_path: FilePath) -> None:
    (tmp_path / "seam.csv").write_text("x,y\n300,200\n310,200\n")
    job = PLANE | {"path": {"file": "seam.csv", "frame": {"position": [0.01, 0, 0]}}}
    with pytest.raises(ac.Unreachable, match="seam.csv seem to have .*`units: mm` or --units mm"):
        teach(parse_job(yaml.safe_dump(job), folder=tmp_path))
