"""A Studio that runs in this process, and somebody who talks with it."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.studio.talking import NoLane
from websockets.sync.client import ClientConnection, connect

from armcontour.studio.desk import Desk
from armcontour.studio.opening import open_session
from armcontour.studio.server import serve
from armcontour.studio.wire import Frame


class Running:
    """A Studio that runs.

    Args:
        address: What it has printed.
        desk: Its session, and how it ends.
    """

    def __init__(self, address: str, desk: Desk) -> None:
        self.address, self.desk = address, desk
        self.base, _, self.token = address.partition("/#")
        self.host = self.base.removeprefix("http://")
        self.port = int(self.host.partition(":")[2])

    def request(
        self,
        method: str,
        path: str,
        body: bytes = b"",
        *,
        token: str | None = "",
        **headers: str | None,
    ) -> tuple[int, Mapping[str, str], bytes]:
        """Send a request as the page does, but for some headers; None leaves one out."""
        own: dict[str, str | None] = {
            "Host": self.host,
            "Origin": None if method == "GET" else self.base,
            "X-Armcontour": None if method == "GET" else "1",
            "Authorization": None if token is None else f"Bearer {token or self.token}",
        }
        own |= {name.replace("_", "-"): x for name, x in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in own.items():
                if value is not None:
                    connection.putheader(name, value)
            if body:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body or None)
            answer = connection.getresponse()
            return answer.status, {k.lower(): x for k, x in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def upload(self, name: str, content: bytes) -> tuple[int, str]:
        """Open a file as the page does; returns the status and the sentence of a refusal."""
        status, _, body = self.request("POST", f"/open?name={name}", content)
        told = json.loads(body) if body.startswith(b"{") else {}
        return status, told.get("sentence", "")

    @contextmanager
    def page(self) -> Iterator[Page]:
        """A page that has given its token."""
        with self.socket() as socket:
            socket.send(json.dumps({"op": "hello", "token": self.token}))
            yield Page(socket)

    @contextmanager
    def socket(self, **how: Any) -> Iterator[ClientConnection]:
        """A socket that has said nothing yet; the page's, but for some options."""
        own = {"origin": self.base, "max_size": None, "compression": None, "proxy": None}
        own |= {"ping_interval": None}
        with connect(f"ws://{self.host}/socket", **own | how) as socket:
            yield socket


class Page:
    """A page, as a program."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket, self.seq = socket, 0

    def say(self, op: str, **more: Any) -> int:
        """Send a message; returns its number."""
        self.seq += 1
        self.socket.send(json.dumps({"op": op, "seq": self.seq, **more}))
        return self.seq

    def hear(self, *kinds: str, seq: int | None = None) -> Frame:
        """The next frame of some kinds that answers a message, or a later one."""
        while True:
            data = self.socket.recv(timeout=20)
            assert isinstance(data, bytes)
            frame = Frame.unpack(data)
            given = frame.header.get("seq")
            if frame.kind in kinds and (seq is None or (given is not None and given >= seq)):
                return frame

    def edit(self, *edits: Mapping[str, Any]) -> int:
        """Make edits, in one gesture."""
        return self.say("edit", gesture=self.seq, final=True, edits=list(edits))


@contextmanager
def running(file: Path | None, **how: Any) -> Iterator[Running]:
    """A Studio in a thread of this process; `how` is of `open_session`."""
    announced, found = threading.Event(), list[Any]()
    how = {"slow": NoLane, **how}

    def announce(address: str) -> None:
        found.append(address)
        announced.set()

    def work() -> None:
        serve(
            lambda say: open_session(file, say=say, **how),
            announce=announce,
            opened=found.append,
        )

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert announced.wait(20)
        while len(found) < 2:
            thread.join(0.01)
        address, desk = found
        yield Running(address, desk)
    finally:
        found[1].stop()
        thread.join(20)
        assert not thread.is_alive()
