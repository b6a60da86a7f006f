"""Jobs that are small enough for tasks."""

from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def drawings():
    return Path(__file__).parents[3] / "examples" / "drawings"


@pytest.fixture
def coarse(paper):
    """The paper's job with fewer set-points and runs."""
    for key in ("experiment", "published"):
        del paper[key]
    paper["runs"] = {x: paper["runs"][x] for x in ("uncompensated", "optimal")}
    for x in paper["runs"].values():
        x["command_interval"] = "2 ms"
    return paper


@pytest.fixture
def short(coarse):
    """The same with a short path."""
    return coarse | {"path": {"points": [[0.35, 0.1], [0.37, 0.12], [0.36, 0.13]]}}


@pytest.fixture
def line(square):
    """The square's job with a short line."""
    return square | {"path": square["path"] | {"points": [[0, 0, 0], [0.01, 0, 0]]}}
