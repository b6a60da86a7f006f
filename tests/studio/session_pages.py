"""Pages that exchange messages with a session in this process, without a server."""

from armcontour.report.message_frame import MessageFrame
from armcontour.studio.document import Document
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.scheduler import SchedulerOptions
from armcontour.studio.session import Session

JOB = """\
name: small
arm: pmk3s
path:
  points: [[350 mm, 100 mm], [410 mm, 150 mm], [280 mm, 300 mm]]   # from the paper
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  slow: {limits: {speed: 50 mm/s}}
  fast: {}
"""
NEVER = 1e6
MOVE = {"do": "move_waypoint", "index": 1, "to": [0.4, 0.16]}


def figure(header, name):
    """The value of a figure of a frame."""
    return {x["name"]: x["value"] for x in header["rows"]}[name]


class RecordingTaskWorker:
    """A task worker that records its tasks and does nothing; `last` is the newest one."""

    def __init__(self, deliver):
        RecordingTaskWorker.last = self
        self.deliver = deliver
        self.given = []
        self.cancelled = []
        self.stopped = []

    def submit(self, id, task, request):
        self.given.append((id, task, request))

    def stop(self, id):
        self.stopped.append(id)

    def cancel(self, id):
        self.cancelled.append(id)

    def close(self):
        pass


class ImmediateWorker:
    """A preview worker that works in the calling thread; newer work comes before any rest."""

    rests = False

    def __init__(self, deliver):
        self.deliver = deliver

    def submit(self, work):
        work(lambda within=0.0: within > 0 and not self.rests)

    def close(self):
        pass


class ManualWorker(ImmediateWorker):
    """A preview worker that only records its works; `last` is the newest one."""

    def __init__(self, deliver):
        super().__init__(deliver)
        ManualWorker.last = self
        self.works = []

    def submit(self, work):
        self.works.append(work)


class RestingWorker(ImmediateWorker):
    """A preview worker without newer work."""

    rests = True


class SessionPage:
    """A page that keeps what it hears."""

    def __init__(self, session):
        self.session = session
        self.seq = 0
        self.frames = []
        session.join(self)

    def send(self, data, replaces=None):
        self.frames.append(MessageFrame.unpack(data))

    def say(self, op, **more):
        """Send a message; returns what is heard then."""
        self.seq += 1
        return self.heard({"op": op, "seq": self.seq, **more})

    def heard(self, message):
        before = len(self.frames)
        self.session.receive(self, message)
        return self.frames[before:]

    def edit(self, *edits, gesture=0, final=True, **more):
        return self.say("edit", gesture=gesture, final=final, edits=list(edits), **more)

    def last(self, kind):
        return next(dict(x.header) for x in reversed(self.frames) if x.kind == kind)


def kinds(frames):
    return [x.kind for x in frames]


def session_of(file, preview_worker=ImmediateWorker, rest=NEVER):
    document = Document.open(file)
    previewer = CoarsePlanner(document.folder)
    return Session(
        document,
        previewer,
        scheduling=SchedulerOptions(preview_worker, RecordingTaskWorker, rest),
    )
