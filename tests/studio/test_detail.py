"""Lines as they are drawn, against the exact path, at every zoom."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.studio.session_pages import ImmediateWorker, RecordingTaskWorker, SessionPage
from tools.studio_page import write_shapes

from armcontour.studio.document import Document
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.scheduler import SchedulerOptions
from armcontour.studio.session import Session

COLUMNS, ROWS, PITCH, RADIUS = 40, 50, 8e-3, 2.5e-3
# Width of the view [px]; half a pixel is not seen.
WIDTH, SEEN = 1000, 0.5


def draw(file, count=COLUMNS * ROWS):
    """Circles, squares and ellipses, in rows."""
    write_shapes(file, count, COLUMNS, 1e3 * PITCH, 1e3 * RADIUS)


def distances(points, line):
    """Distances of points from a polyline [m], by hand."""
    a, along = line[:-1, None], np.diff(line, axis=0)[:, None]
    share = ((points - a) * along).sum(2) / np.maximum((along**2).sum(2), 1e-30)
    nearest = a + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points - nearest, axis=2).min(axis=0)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page that shows 2,000 contours before they are planned, and where shape 0 is drawn."""
    file = tmp_path_factory.mktemp("many") / "many.dxf"
    draw(file)
    document = Document.of_drawing(file, "ur5e")
    session = Session(
        document,
        CoarsePlanner(file.parent),
        scheduling=SchedulerOptions(ImmediateWorker, RecordingTaskWorker, 1e6),
    )
    session.begin()
    tab = SessionPage(session)
    yield tab
    session.close()


@pytest.fixture(scope="module")
def picture(page):
    return next(x for x in page.frames if x.kind == "picture")


@needs_dynamics
def test_a_plan_and_its_execution_are_drawn_finer_too(tmp_path, no_hurry):
    file = tmp_path / "few.dxf"
    draw(file, 3)
    document = Document.of_drawing(file, "ur5e")
    session = Session(
        document,
        CoarsePlanner(tmp_path),
        scheduling=SchedulerOptions(ImmediateWorker, RecordingTaskWorker, 1e6),
    )
    session.begin()
    tab = SessionPage(session)
    picture, executed = (
        next(x for x in tab.frames if x.kind == y) for y in ("picture", "executed")
    )
    planned, view = session.display.scheduler.planned, session.editor.state.handles
    scale, box = 1e6, [-1e-4, -1e-4, 1e-4, 1e-4]
    point = planned.path.contours[0].path(np.array([1e-3]))
    middle = view.plane.uv(point)[0] - view.centre
    (frame,) = tab.say("detail", box=[*(middle + box[:2]), *(middle + box[2:])], px=1 / scale)
    s = frame.arrays["path_s"].astype(float)
    path = planned.path.contours[0].path
    between = np.linspace(s.min(), s.max(), 5000)
    exact = view.plane.uv(path(between)) - view.centre
    assert distances(exact, frame.arrays["path"].astype(float)).max() * scale <= SEEN
    assert frame.header["limits"] == picture.header["limits"]
    assert len(frame.arrays["base"]) and len(frame.arrays["base"]) < len(executed.arrays["base"])
    assert {"speed", "binding", "path_t", "error", "offset"} <= frame.arrays.keys()
    # Where nothing is, nothing is drawn.
    (frame,) = tab.say("detail", box=[1.0, 1.0, 1.1, 1.1], px=1e-4)
    assert all(len(x) <= 1 for x in frame.arrays.values())
    for wrong in ({"box": [0, 0, 1], "px": 1}, {"box": [0, 0, 1, None], "px": 1}, {"px": 1}):
        (answer,) = tab.say("detail", **wrong)
        assert answer.kind == "failed"
    session.close()
