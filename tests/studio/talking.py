"""Pages that talk with a session in this process, without a server."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from armcontour.studio.document import Document
from armcontour.studio.preview import Previewer
from armcontour.studio.session import Session
from armcontour.studio.wire import Frame

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


class NoLane:
    """A slow lane in which nothing happens; the last one that was made can be looked at."""

    last: NoLane

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        NoLane.last = self
        self.deliver = deliver
        self.given: list[tuple[str, str, Mapping[str, Any]]] = []
        self.cancelled: list[str] = []

    def submit(self, id: str, task: str, request: Mapping[str, Any]) -> None:
        self.given.append((id, task, request))

    def cancel(self, id: str) -> None:
        self.cancelled.append(id)

    def close(self) -> None:
        pass


class AtOnce:
    """A fast lane that works where it is asked to."""

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        self.deliver = deliver

    def submit(self, work: Any) -> None:
        for frame in work(lambda: False):
            self.deliver(frame)

    def close(self) -> None:
        pass


class Held(AtOnce):
    """A fast lane that does nothing until it is told to; the last one can be looked at."""

    last: Held

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        super().__init__(deliver)
        Held.last = self
        self.works: list[Any] = []

    def submit(self, work: Any) -> None:
        self.works.append(work)


class Tab:
    """A page that keeps what it hears."""

    def __init__(self, session: Session) -> None:
        self.session, self.seq = session, 0
        self.frames: list[Frame] = []
        session.join(self)

    def send(self, data: bytes, replaces: str | None = None) -> None:
        self.frames.append(Frame.unpack(data))

    def say(self, op: str, **more: Any) -> list[Frame]:
        """Send a message; returns what is heard then."""
        self.seq += 1
        return self.heard({"op": op, "seq": self.seq, **more})

    def heard(self, message: Any) -> list[Frame]:
        before = len(self.frames)
        self.session.receive(self, message)
        return self.frames[before:]

    def edit(self, *edits: Any, gesture: int = 0, final: bool = True, **more: Any) -> list[Frame]:
        return self.say("edit", gesture=gesture, final=final, edits=list(edits), **more)

    def last(self, kind: str) -> dict[str, Any]:
        return next(dict(x.header) for x in reversed(self.frames) if x.kind == kind)


def kinds(frames: list[Frame]) -> list[str]:
    return [x.kind for x in frames]


def session_of(file: Path, fast: Any = AtOnce, rest: float = NEVER) -> Session:
    document = Document.open(file)
    assert document.folder is not None
    return Session(document, Previewer(document.folder), fast=fast, slow=NoLane, rest=rest)
