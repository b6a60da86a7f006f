"""Access control of the Studio: only its own page, opened with the token of the printed address."""

from __future__ import annotations

import secrets
import time
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from armcontour.core.file_access import MEGABYTE

Scope: TypeAlias = MutableMapping[str, Any]
Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

ADDRESS = "127.0.0.1"
# 128 bits cannot be guessed.
TOKEN_BYTES = 16
# Largest upload, and largest message of a page [bytes].
MAX_UPLOAD = 64 * MEGABYTE
MAX_MESSAGE = 16 * MEGABYTE
# Messages of one page per second, and burst: a page sends one per frame of the screen.
RATE, BURST = 500.0, 1000.0
# A header that pages of other servers can send only after a CORS preflight, which fails.
PAGE_HEADER = b"x-armcontour"


def make_token() -> str:
    """Random token, hexadecimal."""
    return secrets.token_hex(TOKEN_BYTES)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Address of the server, and the token that gives access to it."""

    port: int
    token: str = field(default_factory=make_token, repr=False)

    @property
    def hosts(self) -> frozenset[bytes]:
        """Accepted values of the header Host."""
        return frozenset(f"{x}:{self.port}".encode() for x in (ADDRESS, "localhost"))

    @property
    def origins(self) -> frozenset[bytes]:
        """Accepted values of the header Origin."""
        return frozenset(b"http://" + x for x in self.hosts)

    @property
    def page(self) -> str:
        """Address of the page with the token. Browsers do not send the part after `#`."""
        return f"http://{ADDRESS}:{self.port}/#{self.token}"

    def accepts(self, token: object) -> bool:
        """True if the token is right; takes the same time for all wrong tokens."""
        text = token if isinstance(token, str) else ""
        return secrets.compare_digest(text.encode("utf-8", "replace"), self.token.encode())

    @property
    def headers(self) -> list[tuple[bytes, bytes]]:
        """Security headers of every response."""
        sockets = " ".join(f"ws://{x.decode()}" for x in sorted(self.hosts))
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
            f"connect-src 'self' {sockets}; frame-ancestors 'none'; base-uri 'none'; "
            "form-action 'none'"
        )
        return [
            (b"content-security-policy", policy.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"x-frame-options", b"DENY"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-opener-policy", b"same-origin"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"cache-control", b"no-store"),
        ]


class RefusedRequest(Exception):
    """A request that is refused, with its HTTP status."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class AccessControl:
    """ASGI middleware that refuses requests of anything but the Studio's own page."""

    def __init__(self, app: App, endpoint: Endpoint) -> None:
        self.app, self.endpoint = app, endpoint

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer or refuse a request."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                own_headers = [(name, x) for name, x in message.get("headers", [])]
                message = {**message, "headers": [*own_headers, *self.endpoint.headers]}
            await send(message)

        try:
            self._check(scope)
            await self.app(scope, _bounded(receive), answer)
        except RefusedRequest as refusal:
            if scope["type"] == "websocket":
                # Closed before it is accepted, which browsers see as status 403.
                await send({"type": "websocket.close"})
            else:
                await respond(answer, refusal.status, f"{refusal}\n".encode(), "text/plain")

    def _check(self, scope: Scope) -> None:
        """Refuse a request that the Studio's own page would not send."""
        headers = scope["headers"]
        # Both headers are compared with this server. That they are equal proves nothing, because a
        # foreign name may point to this machine (DNS rebinding).
        if not _is_one_of(_header_values(headers, b"host"), self.endpoint.hosts):
            raise RefusedRequest(
                400, "This is the Studio of armcontour: open the address it printed."
            )
        origins = _header_values(headers, b"origin")
        method = scope.get("method", "GET")
        reads = scope["type"] == "http" and method in ("GET", "HEAD")
        if not (reads and not origins) and not _is_one_of(origins, self.endpoint.origins):
            raise RefusedRequest(403, "Only the Studio's own page may send this request.")
        if method not in ("GET", "HEAD", "POST"):
            raise RefusedRequest(405, f"The Studio does not know the method {method}.")
        if scope["type"] == "websocket" or is_public(scope["path"]):
            # A websocket sends the token in its first message, because it cannot have headers.
            return
        if method == "POST" and _header_values(headers, PAGE_HEADER) != [b"1"]:
            raise RefusedRequest(
                403, "A request that changes something needs the header X-Armcontour."
            )
        kind, _, token = b"".join(_header_values(headers, b"authorization")).partition(b" ")
        if kind.lower() != b"bearer" or not self.endpoint.accepts(token.decode("latin-1")):
            raise RefusedRequest(401, "The token is missing or wrong: open the address it printed.")
        length = b"".join(_header_values(headers, b"content-length"))
        if length.isdigit() and int(length) > MAX_UPLOAD:
            raise _too_large()


def is_public(path: str) -> bool:
    """True for files of the page, which contain no user data."""
    return path == "/" or path.startswith("/static/")


class RateLimit:
    """Rate limit of messages, with bursts."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._remaining, self._last = clock, BURST, clock()

    def allow(self) -> bool:
        """Count one message; False if it exceeds the limit."""
        now = self._clock()
        self._remaining = min(BURST, self._remaining + RATE * (now - self._last))
        self._last = now
        if self._remaining < 1.0:
            return False
        self._remaining -= 1.0
        return True


async def respond(
    send: Send,
    status: int,
    body: bytes,
    kind: str,
    headers: Iterable[tuple[bytes, bytes]] = (),
) -> None:
    """Send a complete response."""
    if kind.startswith("text/") or kind == "application/json":
        kind += "; charset=utf-8"
    own_headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
    await send(
        {"type": "http.response.start", "status": status, "headers": [*own_headers, *headers]}
    )
    await send({"type": "http.response.body", "body": body})


def _bounded(receive: Receive) -> Receive:
    """Limit the size of request bodies."""
    size = 0

    async def bounded() -> Message:
        nonlocal size
        message = await receive()
        if message["type"] == "http.request":
            size += len(message.get("body", b""))
            if size > MAX_UPLOAD:
                raise _too_large()
        return message

    return bounded


def _too_large() -> RefusedRequest:
    return RefusedRequest(
        413,
        f"A file opened in the Studio may have {MAX_UPLOAD // MEGABYTE} MB: name a larger one "
        "in the job file, or give a larger log to armcontour identify or armcontour learn.",
    )


def _header_values(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[bytes]:
    return [x for key, x in headers if key.lower() == name]


def _is_one_of(values: list[bytes], allowed: frozenset[bytes]) -> bool:
    """True if there is exactly one value and it is allowed."""
    return len(values) == 1 and values[0] in allowed
