"""A Studio that runs in this process, and a client of its server."""

import http.client
import json
from contextlib import contextmanager
from queue import SimpleQueue
from threading import Thread

from tests.studio.session_pages import RecordingTaskWorker
from websockets.sync.client import connect

from armcontour.report.message_frame import MessageFrame
from armcontour.studio import connection as module
from armcontour.studio.server import serve


class Running:
    """A Studio that runs.

    Args:
        address: What it has printed.
        desk: Its session, and how it ends.
    """

    def __init__(self, address, session_host):
        self.address = address
        self.session_host = session_host
        self.base, _, self.token = address.partition("/#")
        self.host = self.base.removeprefix("http://")
        self.port = int(self.host.partition(":")[2])

    def request(self, method, path, body=b"", *, token="", **headers):
        """Send a request as the page does, but for some headers; None leaves one out."""
        headers_of_page = {
            "Host": self.host,
            "Origin": None if method == "GET" else self.base,
            "X-Armcontour": None if method == "GET" else "1",
            "Authorization": None if token is None else f"Bearer {token or self.token}",
        }
        headers_of_page |= {name.replace("_", "-"): x for name, x in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in headers_of_page.items():
                if value is not None:
                    connection.putheader(name, value)
            if method == "POST" and "Content_Length" not in headers:
                connection.putheader("Content-Length", str(len(body)))
            connection.endheaders(body or None)
            answer = connection.getresponse()
            return answer.status, {k.lower(): x for k, x in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def upload(self, name, content):
        """Open a file as the page does; returns the status and the sentence of a refusal."""
        status, _, body = self.request("POST", f"/open?name={name}", content)
        reply = json.loads(body) if body.startswith(b"{") else {}
        return status, reply.get("sentence", "")

    @contextmanager
    def page(self):
        """A page that has given its token."""
        with self.socket() as socket:
            socket.send(json.dumps({"op": "hello", "token": self.token}))
            yield Page(socket)

    @contextmanager
    def socket(self, **how):
        """A socket that has said nothing yet; the page's, but for some options."""
        connection_options = {
            "origin": self.base,
            "max_size": None,
            "compression": None,
            "proxy": None,
        }
        connection_options |= {"ping_interval": None, "open_timeout": None, "close_timeout": None}
        # With a full queue of frames that nobody reads, the socket could not be closed.
        connection_options["max_queue"] = None
        with connect(f"ws://{self.host}/socket", **connection_options | how) as socket:
            yield socket


class Page:
    """A page, as a program."""

    def __init__(self, socket):
        self.socket = socket
        self.seq = 0

    def say(self, op, **more):
        """Send a message; returns its number."""
        self.seq += 1
        self.socket.send(json.dumps({"op": op, "seq": self.seq, **more}))
        return self.seq

    def hear(self, *kinds, seq=None):
        """The next frame of some kinds that answers a message, or a later one."""
        while True:
            frame = MessageFrame.unpack(self.socket.recv())
            number = frame.header.get("seq")
            if frame.kind in kinds and (seq is None or (number is not None and number >= seq)):
                return frame

    def edit(self, *edits):
        """Make edits, in one gesture."""
        return self.say("edit", gesture=self.seq, final=True, edits=list(edits))


@contextmanager
def running(file, *, make=module.open_session, **how):
    """A Studio in a thread of this process.

    Args:
        file: The job file.
        make: Makes the session, as `open_session`.
        **how: Of `serve`.
    """
    addresses = SimpleQueue()

    def work():
        try:
            serve(
                lambda say: make(file, send=say, task_worker=RecordingTaskWorker),
                announce=addresses.put,
                opened=addresses.put,
                **how,
            )
        finally:
            # If the server does not start, waiting clients are released.
            addresses.put(None)
            addresses.put(None)

    thread = Thread(target=work)
    thread.start()
    address = addresses.get()
    session_host = addresses.get()
    try:
        yield Running(address, session_host)
    finally:
        session_host.stop()
        thread.join()
