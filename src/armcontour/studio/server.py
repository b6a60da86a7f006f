"""Server of the Studio: page, sockets, uploads, downloads.

It imports little, so that it answers while a thread loads the numerical libraries.
"""

from __future__ import annotations

import asyncio
import ctypes
import gc
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, quote

from armcontour.core import palette
from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.studio.access_control import (
    ADDRESS,
    MAX_MESSAGE,
    AccessControl,
    Endpoint,
    Message,
    RateLimit,
    Receive,
    RefusedRequest,
    Scope,
    Send,
    respond,
)
from armcontour.studio.connection import OpenPage, SessionHost

if TYPE_CHECKING:
    from armcontour.studio.session import Session

STATIC = FilePath(__file__).with_name("static")
# Content types of the files of the page. Other files are not served.
CONTENT_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
# Libraries of the extra `studio`.
REQUIRED_LIBRARIES = ("uvicorn", "websockets")
# Time limit for the token of a page [s], and largest number of pages.
HELLO_TIMEOUT = 10.0
MAX_PAGES = 16
# Largest number of connections; a browser has six for files and one per page.
MAX_CONNECTIONS = 100
# Largest number of connections without a complete request.
MAX_IDLE = 50
# The server can end this long after the last page was closed [s].
EXIT_DELAY = 60.0
# Period of checks of the job file [s].
FILE_CHECK_PERIOD = 2.0
# Interval of thread switches [s].
SWITCH_INTERVAL = 5e-4
# Larger arrays are returned to the system when freed [bytes]. By default glibc keeps blocks of up
# to 32 MB, hundreds of MB after motions of minutes.
LARGE_ARRAY, M_MMAP_THRESHOLD = 2**20, -3
# Close codes of websockets.
REFUSED_CODE, BUSY_CODE = 1008, 1013


class Server:
    """ASGI app with the page, its socket, uploads and downloads."""

    def __init__(self, endpoint: Endpoint, session_host: SessionHost) -> None:
        self.endpoint, self.session_host = endpoint, session_host
        self._page = page_files()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] == "websocket":
            await self._serve_socket(scope, receive, send)
            return
        path, reads = scope["path"], scope["method"] != "POST"
        if reads and (path == "/" or path.startswith("/static/")):
            await self._send_page_file(path, send)
        elif reads and path.startswith("/files/"):
            await self._send_download(path.removeprefix("/files/"), send)
        elif not reads and path == "/open":
            await self._open(scope, receive, send)
        else:
            raise RefusedRequest(404, "The Studio has no such page.")

    async def _send_page_file(self, path: str, send: Send) -> None:
        """Send a file of the page."""
        name = path.removeprefix("/static/") if path != "/" else "index.html"
        if name not in self._page:
            # Developers of the page add files.
            self._page = page_files()
        # The name is a key, never a path.
        file = self._page.get(name)
        if file is None:
            raise RefusedRequest(404, "The Studio has no such page.")
        await respond(send, 200, file.read_bytes(), CONTENT_TYPES[file.suffix])

    async def _send_download(self, number: str, send: Send) -> None:
        """Send a file for download."""
        session = self.session_host.session
        file = None if session is None else session.display.pages.files.get(number)
        if file is None:
            raise RefusedRequest(404, "This file is no longer available: create it again.")
        name = f"attachment; filename*=UTF-8''{quote(file.name, safe='')}"
        headers = [(b"content-disposition", name.encode())]
        await respond(send, 200, file.data, file.kind, headers)

    async def _open(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Open an uploaded file, or keep it as a log."""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        name, cell, unknown = (query.get(key, [""])[0] for key in ("name", "cell", "unknown"))
        cell, body = cell or None, await _read_body(receive)
        session = self.session_host.session
        if session is None:
            raise RefusedRequest(503, "The Studio is starting: wait a moment.")
        status, upload = 200, (name, body, cell, unknown, "log" in query)
        try:
            answer = {"name": await asyncio.to_thread(session.open_upload, *upload)}
        except ArmContourError as error:
            from armcontour.studio.page_frame import without_options

            sentence = without_options(str(error))
            status, answer = 422, {"sentence": sentence, "error": type(error).__name__}
        await respond(send, status, json.dumps(answer).encode(), "application/json")

    async def _serve_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve the socket of a page until it is closed."""
        if scope["path"] != "/socket":
            raise RefusedRequest(404, "The Studio has no such socket.")
        await receive()
        await send({"type": "websocket.accept"})
        if not await self._has_token(receive):
            await _close(send, REFUSED_CODE, "The token is missing or wrong.")
            return
        if len(self.session_host.pages) >= MAX_PAGES:
            await _close(send, BUSY_CODE, "Too many pages of this Studio are open: close some.")
            return
        page = OpenPage()
        writing = asyncio.create_task(page.write(send))
        hearing = asyncio.create_task(self._pass_messages(page, receive))
        try:
            await asyncio.to_thread(self.session_host.join, page)
            done, _ = await asyncio.wait([writing, hearing], return_when=asyncio.FIRST_COMPLETED)
            reason = hearing.result() if hearing in done else "The page does not read."
            if reason is not None:
                await _close(send, REFUSED_CODE, reason)
        finally:
            writing.cancel()
            hearing.cancel()
            # In a thread, because leaving waits for running commands.
            await asyncio.to_thread(self.session_host.leave, page)

    async def _has_token(self, receive: Receive) -> bool:
        """True if the first message has the right token."""
        try:
            message = await asyncio.wait_for(receive(), HELLO_TIMEOUT)
        except TimeoutError:
            return False
        message_data = _read_message(message)
        return (
            message_data is not None
            and message_data.get("op") == "hello"
            and self.endpoint.accepts(message_data.get("token"))
        )

    async def _pass_messages(self, page: OpenPage, receive: Receive) -> str | None:
        """Pass on the messages of a page in order; returns a reason to close it, or None."""
        allowance = RateLimit()
        while (message := await receive())["type"] == "websocket.receive":
            if not allowance.allow():
                return "The page sends too many messages."
            message_data = _read_message(message)
            if message_data is None:
                return "A message is no JSON object."
            if not await asyncio.to_thread(self.session_host.receive, page, message_data):
                return "The page sends too many messages before it has joined."
        return None


def page_files() -> dict[str, FilePath]:
    """Files of the page by name."""
    files = {
        x.relative_to(STATIC).as_posix(): x for x in STATIC.rglob("*") if x.suffix in CONTENT_TYPES
    }
    return {**files, palette.PALETTE_FILE.name: palette.PALETTE_FILE}


def serve(
    make: Callable[[Callable[[bytes], None]], Session],
    *,
    port: int = 0,
    announce: Callable[[str], None],
    exit_when_closed: bool = False,
    opened: Callable[[SessionHost], None] = lambda session_host: None,
) -> None:
    """Serve the Studio on this machine until it ends."""
    require_server()
    # Early versions of uvicorn leave the port open if the server is stopped before it has started.
    with listen(port) as listening:
        endpoint = Endpoint(listening.getsockname()[1])
        announce(endpoint.page)
        session_host = SessionHost(make)
        opened(session_host)
        try:
            asyncio.run(_serve(listening, endpoint, session_host, exit_when_closed))
        finally:
            gc.unfreeze()
            if session_host.session is not None:
                session_host.session.close()
    if session_host.failure is not None:
        raise session_host.failure


def require_server() -> None:
    """Check that the libraries of the server are installed."""
    missing = [x for x in REQUIRED_LIBRARIES if find_spec(x) is None]
    if missing:
        raise InvalidInput(
            f"The Studio needs {' and '.join(missing)}: pip install 'armcontour[studio]'."
        )


def listen(port: int) -> socket.socket:
    """Open a port for this machine only; 0 for a free port."""
    # With the protocol named, asyncio sets TCP_NODELAY; otherwise packets wait up to 40 ms for an
    # acknowledgement.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    if os.name == "posix":
        # Connections of a previous server do not block its port. On Windows the option would allow
        # two servers on one port.
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
        listening.listen(MAX_CONNECTIONS)
    except OSError as error:
        listening.close()
        raise InvalidInput(
            f"Port {port} of {ADDRESS} cannot be used: {error.strerror}. Name another one with "
            "--port, or none."
        ) from None
    return listening


def _http_protocol() -> type[asyncio.Protocol]:
    """HTTP protocol that closes the oldest idle connections to make room for new ones."""
    from uvicorn.protocols.http.h11_impl import H11Protocol

    class IdleLimitedProtocol(H11Protocol):  # type: ignore[misc, unused-ignore]
        since = 0.0

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            idle = [
                x for x in self.connections if isinstance(x, IdleLimitedProtocol) and x.is_idle()
            ]
            if len(idle) >= MAX_IDLE:
                min(idle, key=lambda x: x.since).transport.abort()
            self.since = self.loop.time()
            super().connection_made(transport)

        def is_idle(self) -> bool:
            if self.transport.is_closing():
                return False
            return self.cycle is None or bool(self.cycle.response_complete)

    return IdleLimitedProtocol


async def _serve(
    listening: socket.socket, endpoint: Endpoint, session_host: SessionHost, exit_when_closed: bool
) -> None:
    import uvicorn

    # Only errors are logged, without addresses of requests.
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    logging.getLogger("uvicorn.access").disabled = True
    server = uvicorn.Server(
        uvicorn.Config(
            AccessControl(Server(endpoint, session_host), endpoint),
            http=_http_protocol(),
            ws="websockets-sansio",
            loop="asyncio",
            lifespan="off",
            log_config=None,
            access_log=False,
            ws_max_size=MAX_MESSAGE,
            ws_ping_interval=None,
            ws_per_message_deflate=False,
            server_header=False,
            date_header=False,
            limit_concurrency=MAX_CONNECTIONS,
            timeout_graceful_shutdown=1,
        )
    )

    def stop() -> None:
        server.should_exit = True

    # Computing threads release the interpreter lock soon, so that responses are fast.
    sys.setswitchinterval(SWITCH_INTERVAL)
    session_host.stop = stop
    threading.Thread(target=_start, args=(session_host,), name="starting", daemon=True).start()
    watching = asyncio.create_task(watch(session_host, exit_when_closed))
    try:
        await server.serve(sockets=[listening])
    finally:
        watching.cancel()


def _start(session_host: SessionHost) -> None:
    """Create the session and show it."""
    session_host.start()
    if sys.platform == "linux":
        # Other C libraries do not have mallopt.
        with suppress(AttributeError):
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE_ARRAY)
    # Garbage collection skips the loaded modules; otherwise it delays responses by 50 ms.
    gc.freeze()


async def watch(session_host: SessionHost, exit_when_closed: bool) -> None:
    """Check the job file and the open pages periodically."""
    loop = asyncio.get_running_loop()
    was_open, last = False, loop.time()
    while True:
        await asyncio.sleep(min(FILE_CHECK_PERIOD, EXIT_DELAY / 4))
        if session_host.session is not None:
            await asyncio.to_thread(session_host.session.look)
        if session_host.pages:
            was_open, last = True, loop.time()
        elif exit_when_closed and was_open and loop.time() - last >= EXIT_DELAY:
            session_host.stop()


async def _read_body(receive: Receive) -> bytes:
    parts = []
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise RefusedRequest(400, "The page went away.")
        parts.append(message.get("body", b""))
        if not message.get("more_body"):
            return b"".join(parts)


def _read_message(message: Message) -> Mapping[str, Any] | None:
    """A JSON object from a page; None if the message is not one."""
    text = message.get("text")
    try:
        message_data = json.loads(text, parse_constant=_refuse_constant) if text else None
    except (ValueError, RecursionError):
        return None
    return message_data if isinstance(message_data, dict) else None


def _refuse_constant(name: str) -> float:
    """Refuse constants that JSON does not have, such as NaN."""
    raise ValueError(f"{name} is no number.")


async def _close(send: Send, code: int, reason: str) -> None:
    await send({"type": "websocket.close", "code": code, "reason": reason})
