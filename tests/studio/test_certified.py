"""The plan of a certificate: pages show it and export it, while the job is unchanged."""

import csv
import hashlib

import numpy as np
import pytest
from tests.studio.session_pages import (
    RecordingTaskWorker,
    RestingWorker,
    SessionPage,
    figure,
    kinds,
    session_of,
)

import armcontour as ac
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.tasks.dispatch import do

pytestmark = pytest.mark.usefixtures("no_hurry")
TOLERANCE = 3e-3
SPEED = {"do": "set", "key": "limits.speed", "value": "40 mm/s"}


def work(session, id):
    """Execute the task that the session has started last, and let the session receive its frame."""
    number, task, request = RecordingTaskWorker.last.given[-1]
    assert number == id
    frame = do(task, request, lambda step: None).stamped(id=id, task=task)
    session._send_state_frame(MessageFrame.unpack(frame.pack()), None)
    return frame.header, frame.arrays["content"].tobytes()


@pytest.fixture
def certified(file):
    """A session with the certificate `c1` of the run `fast`, its page, and the certificate."""
    session = session_of(file, RestingWorker)
    session.begin()
    tab = SessionPage(session)
    tab.say("select", run="fast")
    tab.say("task", id="c1", task="certify", options={"tolerance": TOLERANCE})
    _, report = work(session, "c1")
    certificate = ac.certify(
        ac.read_job(file), run="fast", goal=ac.CertificateGoal(tolerance=TOLERANCE)
    )
    yield session, tab, certificate, report.decode()
    session.close()


def test_a_certified_plan_is_shown_instead_of_that_of_the_run(certified):
    _, tab, certificate, _ = certified
    result = tab.last("result")
    duration = certificate.result.trajectory.duration
    assert result["has_plan"]
    # Another run is shown when the plan is asked for.
    tab.say("select", run="slow")
    slow = figure(tab.last("picture"), "duration")
    assert slow > 1.5 * duration
    frames = tab.say("show_certified", id="c1")
    assert {"document", "picture", "figures", "executed"} <= set(kinds(frames))
    assert tab.last("document")["run"] == "fast"
    picture = tab.last("picture")
    assert (picture["tier"], picture["certificate"]) == ("certified", "c1")
    assert figure(picture, "duration") == pytest.approx(duration, rel=1e-9)
    shown = tab.last("figures")
    assert shown["run"] == "fast"
    assert figure(shown, "duration") == pytest.approx(duration, rel=1e-9)
    error = certificate.result.evaluation.contour_error.max
    assert figure(shown, "contour_error.max") == pytest.approx(error, rel=1e-6)
    # The run's own plan is another one; it comes back by a command, and by an edit.
    tab.say("show_run")
    picture = tab.last("picture")
    assert picture["tier"] != "certified" and "certificate" not in picture
    assert figure(picture, "duration") != pytest.approx(duration, rel=1e-4)
    tab.say("show_certified", id="c1")
    tab.edit(SPEED)
    assert tab.last("picture")["tier"] != "certified"


def test_a_certified_plan_is_exported(certified):
    session, tab, certificate, report = certified
    options = {"format": "csv", "of": "certified", "certificate": "c1"}
    tab.say("select", run="slow")
    tab.say("task", id="e1", task="export", options=options)
    header, content = work(session, "e1")
    assert header["name"] == "small-fast-certified.csv"
    # The certificate has the fingerprint of this file.
    assert hashlib.sha256(content).hexdigest()[:12] in report
    rows = list(csv.reader(content.decode().splitlines()))
    head = next(k for k, row in enumerate(rows) if row[0].startswith("t"))
    written = np.array(rows[head + 1 :], dtype=float)
    set_points = certificate.result.set_points
    assert len(written) == len(set_points.t)
    # The times of the file begin at 0.
    assert np.abs(written[:, 0] - set_points.t + set_points.t[0]).max() < 1e-6
    joints = [rows[head].index(x) for x in rows[head] if x.startswith("q")]
    assert np.abs(written[:, joints] - set_points.q).max() < 1e-6
    assert tab.last("result")["made"]["run"] == "fast"


def test_the_plan_of_another_job_is_neither_shown_nor_exported(certified):
    _, tab, *_ = certified
    options = {"format": "csv", "of": "certified", "certificate": "c1"}
    tab.edit(SPEED)
    count = len(RecordingTaskWorker.last.given)
    for frames in (
        tab.say("show_certified", id="c1"),
        tab.say("task", id="e1", task="export", options=options),
        tab.say("show_certified", id="c9"),
        tab.say("show_certified", id=[1]),
        tab.say("task", id="e2", task="export", options={**options, "certificate": "c9"}),
    ):
        (frame,) = frames
        assert frame.kind == "failed"
    assert "40 mm/s" in tab.say("show_certified", id="c1")[0].header["sentence"]
    assert len(RecordingTaskWorker.last.given) == count
    # With the edit undone, the certificate is that of the job again.
    tab.say("undo")
    tab.say("show_certified", id="c1")
    assert tab.last("picture")["tier"] == "certified"
