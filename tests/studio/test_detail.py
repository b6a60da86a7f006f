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


def middle_of(k):
    return np.array([k % COLUMNS, k // COLUMNS]) * PITCH


def draw(file, count=COLUMNS * ROWS):
    """Circles, squares and ellipses, in rows."""
    write_shapes(file, count, COLUMNS, 1e3 * PITCH, 1e3 * RADIUS)


def shape_of(kind, count=2000):
    """Points all along a shape, whose middle is zero, by its formula."""
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    if kind == 1:
        side = np.linspace(-1, 1, count // 4, endpoint=False)
        one = np.ones_like(side)
        sides = [(side, -one), (one, side), (-side, one), (-one, -side)]
        return RADIUS * np.concatenate([np.stack(x, axis=1) for x in sides])
    return RADIUS * np.stack([np.cos(turn), np.sin(turn) / (1 + (kind == 2))], axis=1)


def distances(points, line):
    """Distances of points from a polyline [m], by hand."""
    a, along = line[:-1, None], np.diff(line, axis=0)[:, None]
    share = ((points - a) * along).sum(2) / np.maximum((along**2).sum(2), 1e-30)
    nearest = a + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points - nearest, axis=2).min(axis=0)


class Shown:
    """The lines of a frame, by the shape that each is around."""

    def __init__(self, frame, origin, name="objective"):
        points = frame.arrays[name].astype(float) - origin
        self.lines = {}
        for line in np.split(points, frame.arrays[f"{name}_breaks"][1:-1]):
            column, row = np.round((line.min(0) + line.max(0)) / 2 / PITCH).astype(int)
            self.lines.setdefault(int(row * COLUMNS + column), []).append(
                line - middle_of(row * COLUMNS + column)
            )


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
def program(page):
    """The drawing as it was read."""
    return page.session.editor.state.job.program


@pytest.fixture(scope="module")
def picture(page):
    return next(x for x in page.frames if x.kind == "picture")


@pytest.fixture(scope="module")
def origin(picture):
    """The middle of the first circle on the screen."""
    points = picture.arrays["objective"].astype(float)
    return points.min(axis=0) + RADIUS


@pytest.mark.parametrize("scale", [3e3, 3e4, 3e5, 4e6])
@pytest.mark.parametrize("k", [0, 901, 1502])
def test_what_is_seen_closer_is_drawn_finer(page, program, picture, origin, scale, k):
    exact = origin + middle_of(k) + shape_of(k % 3, 40_000)
    if k % 3 == 2:
        # Ellipses are read as arcs, which are near to them.
        path = program.contours[k].path
        samples = path(np.linspace(0, path.length, 40_000))[:, :2]
        exact = origin + samples - program.contours[0].path(0.0)[:2] + [RADIUS, 0]
        assert np.abs(exact.mean(0) - origin - middle_of(k)).max() < 1e-5
    # A view of 1,000 px around a point of the shape.
    middle, half = exact[7_000], WIDTH / 2 / scale
    box = [*(middle - half), *(middle + half)]
    (frame,) = page.say("detail", box=box, px=1 / scale)
    assert frame.header["number"] == picture.header["number"]
    points, breaks = frame.arrays["objective"].astype(float), frame.arrays["objective_breaks"]
    visible = exact[(np.abs(exact - middle) <= half).all(axis=1)]
    lines = np.split(points, breaks[1:-1])
    own_lines = [x for x in lines if np.abs(x - origin - middle_of(k)).max() < 1.1 * RADIUS]
    nearest = np.min([distances(visible[::97], x) for x in own_lines], axis=0)
    assert len(nearest) and nearest.max() * scale <= SEEN
    # Little more than what is seen is sent.
    assert len(points) < 40_000 and np.abs(points - middle).max() < 3 * half + 2 * RADIUS


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
