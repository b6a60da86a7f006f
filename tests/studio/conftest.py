"""What the tests of the studio share: jobs as data, and the plane that they are drawn in."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from soak.studio_page import SQUARE
from tests.studio.talking import JOB, Tab, session_of

from armcontour._yaml import load
from armcontour.studio import screen
from armcontour.studio.preview import Previewer
from armcontour.studio.previewed import Planned
from armcontour.studio.session import Session
from armcontour.studio.view import View

ROOT = Path(__file__).parents[2]
PAPER = load(files("armcontour.jobs.library").joinpath("paper.yaml").read_text(), "paper")
SQUARE_DATA = load(SQUARE, "square")


class Flat:
    """The plane of x and y."""

    origin = np.array([0.01, 0.02, 0.0])
    x = np.array([1.0, 0.0, 0.0])
    y = np.array([0.0, 1.0, 0.0])


@pytest.fixture
def no_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans are quick however busy the machine is."""
    monkeypatch.setattr(screen, "QUICK", 1e6)


@pytest.fixture
def paper() -> dict[str, Any]:
    return copy.deepcopy(PAPER)


@pytest.fixture
def square() -> dict[str, Any]:
    return copy.deepcopy(SQUARE_DATA)


@pytest.fixture(scope="session")
def view() -> View:
    return View(Flat(), np.array([0.3, 0.2]))


@pytest.fixture
def previewer() -> Previewer:
    return Previewer(ROOT / "examples" / "drawings")


@pytest.fixture(scope="session")
def previewer_of_plans() -> Previewer:
    """That of `plans`, which keeps their results."""
    return Previewer(ROOT / "examples" / "drawings")


@pytest.fixture(scope="session")
def plans(previewer_of_plans: Previewer) -> dict[str, Planned]:
    """Plans of the paper's job, by run."""
    names = ("uncompensated", "proposed", "conventional", "optimal")
    return {x: previewer_of_plans.plan(PAPER, x) for x in names}


@pytest.fixture(scope="session")
def gasket_plan(previewer_of_plans: Previewer) -> Planned:
    """The plan of a drawing of several contours, with an arm in space."""
    drawing = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
    return previewer_of_plans.plan(SQUARE_DATA | {"path": drawing})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    place = tmp_path / "job.yaml"
    place.write_text(JOB)
    return place


@pytest.fixture
def session(file: Path) -> Iterator[Session]:
    found = session_of(file)
    found.begin()
    yield found
    found.close()


@pytest.fixture
def tab(session: Session) -> Tab:
    return Tab(session)
