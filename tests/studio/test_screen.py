"""What is shown while a person edits, and when nothing changes any more."""

import threading
from contextlib import closing, contextmanager
from importlib import resources

import pytest
from tests.studio.talking import AtOnce, figure

import armcontour as ac
from armcontour._yaml import load
from armcontour.io import parse_job
from armcontour.io.job_edits import Change, change_text
from armcontour.studio.handles import handles_of
from armcontour.studio.preview import Previewer
from armcontour.studio.screen import Screen, Shown
from armcontour.studio.view import View

TEXT = (resources.files("armcontour.jobs") / "library" / "paper.yaml").read_text("utf-8")
DATA = load(TEXT, "job")
pytestmark = pytest.mark.usefixtures("no_hurry")


class Heard:
    """Frames of a screen, which can be waited for."""

    def __init__(self):
        self.frames = []
        # States that the document has left before pages could have them.
        self.late = []
        self._news = threading.Condition()

    def __call__(self, frame, shown):
        with self._news:
            self.frames.append((frame, shown))
            self._news.notify_all()
        return shown not in self.late

    def wait(self, kind, shown):
        with self._news:
            self._news.wait_for(lambda: self.of(kind, shown))

    def of(self, kind, shown):
        return [frame for frame, y in self.frames if frame.kind == kind and y is shown]


@contextmanager
def showing(previewer=None, lane=AtOnce):
    """A screen, what it tells, and a function that makes states; by default all is done at once."""
    heard, previewer = Heard(), previewer or Previewer()

    def make(data=DATA, run="optimal", moving=False):
        handles = handles_of(previewer.job(data, run), data)
        view = View(handles.plane, handles.centre)
        return Shown(data=data, run=run, view=view, rev=0, answers={}, moving=moving)

    with closing(Screen(previewer, heard, lane)) as screen:
        yield screen, heard, make


@pytest.mark.parametrize("run", ["optimal", "shaped"])
def test_at_rest_the_picture_is_that_of_a_full_run(run):
    others = [Change(("runs", x)) for x in DATA["runs"] if x != run]
    changes = [*others, Change(("experiment",))]
    want = ac.run(parse_job(change_text(TEXT, changes, "job"))).runs[run].evaluation
    with showing() as (screen, heard, make):
        screen.show(state := make(run=run))
        assert (
            figure(heard.of("executed", state)[-1].header, "contour_error.rms")
            != want.contour_error.rms
        )
        screen.rest()
        _, picture = heard.of("picture", state)
        assert figure(picture.header, "duration") == want.duration
        assert figure(heard.frames[-1][0].header, "contour_error.rms") == want.contour_error.rms


def test_what_moves_is_planned_on_a_coarser_grid_until_it_rests():
    data = load(TEXT.replace("interval: 0.2 ms", "interval: 4 ms"), "job")
    fine = Previewer().plan(data, "optimal").trajectory
    with showing() as (screen, heard, make):
        screen.show(state := make(data, moving=True))
        (coarse,), (_,) = heard.of("picture", state), heard.of("executed", state)
        assert figure(coarse.header, "duration") == pytest.approx(fine.duration, rel=1e-3)
        assert figure(coarse.header, "duration") != fine.duration
        assert any("600 intervals" in x for x in coarse.header["notes"])
        screen.rest()
        assert len(heard.of("executed", state)) == 2
        assert figure(heard.of("picture", state)[-1].header, "duration") == fine.duration
        assert not heard.of("picture", state)[-1].header["notes"]
