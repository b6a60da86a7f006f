"""Server of the Studio: page, websockets, uploads, downloads.

The module imports little, so that the server answers while a thread loads numerical libraries.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, quote

from armcontour.core.errors import ArmContourError, InvalidInput
from armcontour.core.render import PALETTE_FILE
from armcontour.studio.access_control import (
    ADDRESS,
    MAX_MESSAGE,
    AccessControl,
    Endpoint,
    Message,
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
# The viewer and the libraries, which reports also contain.
SHARED = STATIC.parents[1] / "report" / "static"
# Content types of the page's files, by extension. Files with other extensions are not served.
CONTENT_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
}
# Libraries that the optional dependency group `studio` installs.
REQUIRED_LIBRARIES = ("uvicorn", "websockets")
# Time within which a page must send the token [s].
HELLO_TIMEOUT = 10.0
# Maximum period of the checks for open pages and for changes of the job file [s].
FILE_CHECK_PERIOD = 2.0
# Interval at which the interpreter switches threads [s].
SWITCH_INTERVAL = 5e-4
# Close code of refused websockets.
REFUSED_CODE = 1008


class Server:
    """ASGI application that serves the page, its websocket, uploads and downloads.

    Args:
        endpoint: Address and token of the server.
        session_host: Creates the session that pages join.
    """

    def __init__(self, endpoint: Endpoint, session_host: SessionHost) -> None:
        self.endpoint = endpoint
        self.session_host = session_host
        self._page = page_files()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Respond to a request or serve a websocket."""
        if scope["type"] == "websocket":
            await self._serve_socket(scope, receive, send)
            return
        path = scope["path"]
        reads = scope["method"] != "POST"
        if reads and (path == "/" or path.startswith("/static/")):
            await self._send_page_file(path, send)
        elif reads and path.startswith("/files/"):
            await self._send_download(path.removeprefix("/files/"), send)
        elif not reads and path == "/open":
            await self._open(scope, receive, send)
        else:
            raise RefusedRequest(404, "The Studio has no such page.")

    async def _send_page_file(self, path: str, send: Send) -> None:
        """Send a static file of the page."""
        name = path.removeprefix("/static/") if path != "/" else "index.html"
        if name not in self._page:
            # The file may have been added during development.
            self._page = page_files()
        # The name is only used as a key, never as a file path.
        file = self._page.get(name)
        if file is None:
            raise RefusedRequest(404, "The Studio has no such page.")
        await respond(send, 200, file.read_bytes(), CONTENT_TYPES[file.suffix])

    async def _send_download(self, number: str, send: Send) -> None:
        """Send a stored file for download."""
        session = self.session_host.session
        file = None if session is None else session.pages.files.get(number)
        if file is None:
            raise RefusedRequest(404, "This file is no longer available. Create it again.")
        name = f"attachment; filename*=UTF-8''{quote(file.name, safe='')}"
        headers = [(b"content-disposition", name.encode())]
        await respond(send, 200, file.data, "application/octet-stream", headers)

    async def _open(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Open an uploaded file, or store it as a log or as a mesh."""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        name, cell, unknown = (query.get(key, [""])[0] for key in ("name", "cell", "unknown"))
        cell = cell or None
        body = await _read_body(receive)
        session = self.session_host.session
        if session is None:
            raise RefusedRequest(503, "The Studio is still starting. Try again in a moment.")
        status = 200
        opening = partial(
            session.open_upload, name, body, cell, unknown, log="log" in query, mesh="mesh" in query
        )
        try:
            answer = {"name": await asyncio.to_thread(opening)}
        except ArmContourError as error:
            from armcontour.report.message_frame import without_options

            sentence = without_options(str(error))
            status = 422
            answer = {"sentence": sentence, "error": type(error).__name__}
        await respond(send, status, json.dumps(answer).encode(), "application/json")

    async def _serve_socket(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve the websocket of a page until it is closed."""
        if scope["path"] != "/socket":
            raise RefusedRequest(404, "The address of the Studio's websocket is /socket.")
        await receive()
        await send({"type": "websocket.accept"})
        if not await self._has_token(receive):
            await _close(send, REFUSED_CODE, "The token is missing or wrong.")
            return
        page = OpenPage()
        tasks: list[asyncio.Task[Any]] = [asyncio.create_task(page.write(send))]
        try:
            await asyncio.to_thread(self.session_host.join, page)
            # The session ignores messages of a page before it has joined.
            hearing = asyncio.create_task(self._pass_messages(page, receive))
            tasks.append(hearing)
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            if hearing in done and not hearing.result():
                await _close(send, REFUSED_CODE, "A message is not a JSON object.")
        finally:
            for task in tasks:
                task.cancel()
            # `leave` runs in a thread, because it waits for running commands.
            await asyncio.to_thread(self.session_host.leave, page)

    async def _has_token(self, receive: Receive) -> bool:
        """Return whether the first message contains the correct token."""
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

    async def _pass_messages(self, page: OpenPage, receive: Receive) -> bool:
        """Pass messages of a page to the session in order; False after an invalid message."""
        while (message := await receive())["type"] == "websocket.receive":
            message_data = _read_message(message)
            if message_data is None:
                return False
            await asyncio.to_thread(self.session_host.receive, page, message_data)
        return True


def page_files() -> dict[str, FilePath]:
    """List the page's static files, by name."""
    files = {}
    for folder in (SHARED, STATIC):
        for file in folder.rglob("*"):
            if file.suffix in CONTENT_TYPES:
                files[file.relative_to(folder).as_posix()] = file
    files[PALETTE_FILE.name] = PALETTE_FILE
    return files


def serve(
    make: Callable[[Callable[..., None]], Session],
    *,
    port: int = 0,
    announce: Callable[[str], None],
    opened: Callable[[SessionHost], None] = lambda session_host: None,
) -> None:
    """Serve the Studio on this machine until it is stopped."""
    require_server()
    # `with` closes the port, because early versions of uvicorn leave it open if the server is
    # stopped before it has started.
    with listen(port) as listening:
        endpoint = Endpoint(listening.getsockname()[1])
        announce(endpoint.page)
        session_host = SessionHost(make)
        opened(session_host)
        try:
            asyncio.run(_serve(listening, endpoint, session_host))
        finally:
            gc.unfreeze()
            if session_host.session is not None:
                session_host.session.close()
    if session_host.failure is not None:
        raise session_host.failure


def require_server() -> None:
    """Raise InvalidInput if libraries of the server are not installed."""
    missing = [x for x in REQUIRED_LIBRARIES if find_spec(x) is None]
    if missing:
        raise InvalidInput(
            f"The Studio requires {' and '.join(missing)}. Install with "
            "pip install 'armcontour[studio]'."
        )


def listen(port: int) -> socket.socket:
    """Open a socket that listens to connections from this machine; port 0: any free port."""
    # asyncio sets TCP_NODELAY only for sockets with an explicit protocol. Without TCP_NODELAY,
    # packets can be delayed by up to 40 ms.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    if os.name == "posix":
        # The port can be reused although old connections of a previous server still exist. On
        # Windows, this option would allow two servers on one port.
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise InvalidInput(
            f"Port {port} of {ADDRESS} cannot be used: {error.strerror}. Specify another port with "
            "--port, or omit --port to use a free port."
        ) from None
    return listening


async def _serve(listening: socket.socket, endpoint: Endpoint, session_host: SessionHost) -> None:
    """Serve the page on an open socket until the session host stops the server."""
    import uvicorn

    # Only errors are logged. The access log is disabled, so that no addresses are logged.
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    logging.getLogger("uvicorn.access").disabled = True
    server = uvicorn.Server(
        uvicorn.Config(
            AccessControl(Server(endpoint, session_host), endpoint),
            http="h11",
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
            timeout_graceful_shutdown=1,
        )
    )

    def stop() -> None:
        server.should_exit = True

    # With a short switch interval, computing threads release the interpreter lock soon, so that
    # responses are fast.
    sys.setswitchinterval(SWITCH_INTERVAL)
    session_host.stop = stop
    threading.Thread(target=_start, args=(session_host,), name="starting", daemon=True).start()
    watching = asyncio.create_task(_watch(session_host))
    try:
        await server.serve(sockets=[listening])
    finally:
        watching.cancel()


def _start(session_host: SessionHost) -> None:
    """Create and show the session, then configure memory management."""
    # A session has few cycles, and collections take a tenth of its time.
    gc.disable()
    session_host.start()
    gc.enable()
    # Garbage collection skips the objects of the loaded modules; including them would delay
    # responses by 50 ms.
    gc.freeze()


async def _watch(session_host: SessionHost) -> None:
    """Check periodically for changes of the job file."""
    while True:
        await asyncio.sleep(FILE_CHECK_PERIOD)
        if session_host.session is not None:
            await asyncio.to_thread(session_host.session.look)


async def _read_body(receive: Receive) -> bytes:
    """Return the body of a request; refuse a request that the page does not complete."""
    parts = []
    while True:
        message = await receive()
        if message["type"] != "http.request":
            raise RefusedRequest(400, "The page closed the connection during the upload.")
        parts.append(message.get("body", b""))
        if not message.get("more_body"):
            return b"".join(parts)


def _read_message(message: Message) -> Mapping[str, Any] | None:
    """Decode a message of a page; None if the message is not a JSON object."""
    text = message.get("text")
    try:
        message_data = json.loads(text, parse_constant=_refuse_constant) if text else None
    except (ValueError, RecursionError):
        return None
    return message_data if isinstance(message_data, dict) else None


def _refuse_constant(name: str) -> float:
    """Refuse constants that are not valid JSON, such as NaN."""
    raise ValueError(f"{name} is not valid JSON.")


async def _close(send: Send, code: int, reason: str) -> None:
    """Close a socket with a code and a reason."""
    await send({"type": "websocket.close", "code": code, "reason": reason})
