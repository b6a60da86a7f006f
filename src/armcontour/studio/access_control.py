"""Access control: the Studio serves only its own page, opened with the token in the address."""

from __future__ import annotations

import secrets
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
# Number of random bytes in the token: 128 bits cannot be guessed.
TOKEN_BYTES = 16
# Maximum size of an upload [bytes].
MAX_UPLOAD = 64 * MEGABYTE
# Maximum size of a message from a page [bytes].
MAX_MESSAGE = 16 * MEGABYTE
# Required header of POST requests. Pages of other servers can send it only after a CORS preflight
# request, which this server refuses.
PAGE_HEADER = b"x-armcontour"


def make_token() -> str:
    """Create a random token of hexadecimal digits."""
    return secrets.token_hex(TOKEN_BYTES)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Address of the server, and the token that gives access to it.

    Args:
        port: Port on this machine.
        token: The token; random by default.
    """

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
        """Address of the page with the token after `#`; browsers do not send the part after `#`."""
        return f"http://{ADDRESS}:{self.port}/#{self.token}"

    def accepts(self, token: object) -> bool:
        """Return whether the token is correct, in the same time for all wrong tokens."""
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
    """Refusal of a request.

    Args:
        status: HTTP status of the response.
        sentence: Text of the response.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class AccessControl:
    """ASGI middleware that accepts requests only from the Studio's own page.

    Args:
        app: The application that answers accepted requests.
        endpoint: Address and token of the server.
    """

    def __init__(self, app: App, endpoint: Endpoint) -> None:
        self.app = app
        self.endpoint = endpoint

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a valid request to the application; refuse an invalid request."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return

        async def answer(message: Message) -> None:
            """Send a message of the application, with the security headers in a response."""
            if message["type"] == "http.response.start":
                own_headers = [(name, x) for name, x in message.get("headers", [])]
                message = {**message, "headers": [*own_headers, *self.endpoint.headers]}
            await send(message)

        try:
            self._check(scope)
            await self.app(scope, receive, answer)
        except RefusedRequest as refusal:
            if scope["type"] == "websocket":
                # A websocket that is closed before it is accepted results in status 403.
                await send({"type": "websocket.close"})
            else:
                await respond(answer, refusal.status, f"{refusal}\n".encode(), "text/plain")

    def _check(self, scope: Scope) -> None:
        """Refuse a request that the Studio's own page would not send."""
        headers = scope["headers"]
        # Host and Origin are compared with the address of this server, not with each other, because
        # a foreign host name can resolve to this machine (DNS rebinding).
        if not _is_one_of(_header_values(headers, b"host"), self.endpoint.hosts):
            raise RefusedRequest(
                400,
                "The Studio of armcontour does not accept this address. Open the address that "
                "armcontour studio has printed.",
            )
        origins = _header_values(headers, b"origin")
        method = scope.get("method", "GET")
        reads = scope["type"] == "http" and method in ("GET", "HEAD")
        if not (reads and not origins) and not _is_one_of(origins, self.endpoint.origins):
            raise RefusedRequest(403, "Only the Studio's own page may send this request.")
        if method not in ("GET", "HEAD", "POST"):
            raise RefusedRequest(
                405, f"The Studio supports the methods GET, HEAD and POST, but not {method}."
            )
        if scope["type"] == "websocket" or is_public(scope["path"]):
            # A websocket sends the token in its first message, because it cannot have headers.
            return
        if method == "POST" and _header_values(headers, PAGE_HEADER) != [b"1"]:
            raise RefusedRequest(
                403, "A POST request to the Studio requires the header X-Armcontour with value 1."
            )
        kind, _, token = b"".join(_header_values(headers, b"authorization")).partition(b" ")
        if kind.lower() != b"bearer" or not self.endpoint.accepts(token.decode("latin-1")):
            raise RefusedRequest(
                401,
                "The token is missing or wrong. Open the address that armcontour studio has "
                "printed.",
            )
        length = b"".join(_header_values(headers, b"content-length")).decode("latin-1")
        if method == "POST" and (not length.isdecimal() or int(length) > MAX_UPLOAD):
            raise RefusedRequest(
                413,
                "A file that is opened in the Studio must not exceed "
                f"{MAX_UPLOAD // MEGABYTE} MB. Specify a larger file in the job file, or use "
                "armcontour identify or armcontour learn for a larger log.",
            )


def is_public(path: str) -> bool:
    """Return whether a path needs no token: files of the page, which contain no user data."""
    return path == "/" or path.startswith("/static/")


async def respond(
    send: Send, status: int, body: bytes, kind: str, headers: Iterable[tuple[bytes, bytes]] = ()
) -> None:
    """Send a response with status, headers and body."""
    if kind.startswith("text/") or kind == "application/json":
        kind += "; charset=utf-8"
    own_headers = [(b"content-type", kind.encode()), (b"content-length", str(len(body)).encode())]
    await send(
        {"type": "http.response.start", "status": status, "headers": [*own_headers, *headers]}
    )
    await send({"type": "http.response.body", "body": body})


def _header_values(headers: Iterable[tuple[bytes, bytes]], name: bytes) -> list[bytes]:
    return [x for key, x in headers if key.lower() == name]


def _is_one_of(values: list[bytes], allowed: frozenset[bytes]) -> bool:
    """Return whether exactly one value is given and this value is allowed."""
    return len(values) == 1 and values[0] in allowed
