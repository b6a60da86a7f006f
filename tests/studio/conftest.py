"""Fixtures of the Studio's tests: jobs as data, and the plane of the picture."""

import copy
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from tests.cli.conftest import command
from tests.studio.robot_logs import log, robot
from tests.studio.session_pages import JOB, SessionPage, session_of
from tools.studio_page import SQUARE

from armcontour.core.yaml_loader import load
from armcontour.report.view import Plane, View
from armcontour.studio import scheduler
from armcontour.studio.preview import CoarsePlanner

__all__ = ["command", "log", "robot"]

DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"
PAPER = load(files("armcontour.jobs.library").joinpath("paper.yaml").read_text(), "paper")
SQUARE_DATA = load(SQUARE, "square")


# The plane of x and y
FLAT = Plane(origin=np.array([0.01, 0.02, 0.0]), x=np.eye(3)[0], y=np.eye(3)[1])


@pytest.fixture(autouse=True)
def home(tmp_path_factory, monkeypatch):
    """The user's folder of drafts and uploads, which is empty."""
    folder = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


@pytest.fixture
def no_hurry(monkeypatch):
    """Plans are quick however busy the machine is."""
    monkeypatch.setattr(scheduler, "FAST_PLAN", 1e6)
    monkeypatch.setattr(scheduler, "SLOW_PLAN", 1e6)


@pytest.fixture
def paper():
    return copy.deepcopy(PAPER)


@pytest.fixture
def square():
    return copy.deepcopy(SQUARE_DATA)


@pytest.fixture(scope="session")
def view():
    return View(FLAT, np.array([0.3, 0.2]))


@pytest.fixture
def previewer():
    return CoarsePlanner(DRAWINGS)


@pytest.fixture(scope="session")
def previewer_of_plans():
    """The previewer of `plans`, which keeps their results."""
    return CoarsePlanner(DRAWINGS)


@pytest.fixture(scope="session")
def plans(previewer_of_plans):
    """Plans of the paper's job, by run."""
    names = ("uncompensated", "proposed", "conventional", "optimal")
    return {x: previewer_of_plans.plan(PAPER, x) for x in names}


@pytest.fixture(scope="session")
def gasket_plan(previewer_of_plans):
    """The plan of a drawing of several contours, with an arm in space."""
    drawing = {"file": "gasket.dxf", "orientation": {"axis": [0, 0, -1]}}
    return previewer_of_plans.plan(SQUARE_DATA | {"path": drawing})


@pytest.fixture
def file(tmp_path):
    place = tmp_path / "job.yaml"
    place.write_text(JOB)
    return place


@pytest.fixture
def session(file):
    opened = session_of(file)
    opened.begin()
    yield opened
    opened.close()


@pytest.fixture
def tab(session):
    return SessionPage(session)
