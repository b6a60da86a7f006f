"""Who may talk to the Studio."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from armcontour.studio.guard import (
    BURST,
    LARGEST_UPLOAD,
    RATE,
    Allowance,
    Door,
    Guard,
    Message,
    make_token,
    respond,
)

DOOR = Door(4711, "0123456789abcdef0123456789abcdef")
HOST = (b"host", b"127.0.0.1:4711")
ORIGIN = (b"origin", b"http://127.0.0.1:4711")
TOKEN = (b"authorization", b"Bearer " + DOOR.token.encode())
OWN = (b"x-armcontour", b"1")


def ask(
    headers: list[tuple[bytes, bytes]],
    *,
    path: str = "/",
    method: str = "GET",
    type: str = "http",
    body: list[bytes] | None = None,
) -> tuple[list[Message], int]:
    """What the guard answers, and how many bytes of the body came through to the app."""
    parts = list(body or [b""])
    sent: list[Message] = []
    read = 0

    async def receive() -> Message:
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message: Message) -> None:
        sent.append(message)

    async def app(scope: Any, receive: Any, send: Any) -> None:
        nonlocal read
        more = scope["type"] == "http"
        while more:
            message = await receive()
            read += len(message["body"])
            more = message["more_body"]
        await respond(send, 200, b"in", "text/plain")

    scope = {"type": type, "path": path, "headers": headers}
    if type == "http":
        scope["method"] = method
    asyncio.run(Guard(app, DOOR)(scope, receive, send))
    return sent, read


def status(*headers: tuple[bytes, bytes], **how: Any) -> int:
    return int(ask(list(headers), **how)[0][0]["status"])


def test_the_page_is_for_everybody_who_names_the_host() -> None:
    assert status(HOST) == status((b"Host", b"localhost:4711")) == 200
    assert status(HOST, path="/static/app.js", method="HEAD") == 200
    assert status(HOST, ORIGIN) == 200


@pytest.mark.parametrize(
    "host",
    [
        b"attacker.test:4711",
        b"127.0.0.1",
        b"127.0.0.1:4712",
        b"[::1]:4711",
        b"127.0.0.1:4711.a",
        b"",
    ],
)
def test_other_hosts_are_refused(host: bytes) -> None:
    assert status((b"host", host)) == 400
    assert status((b"host", host), (b"origin", b"http://" + host)) == 400


def test_one_host_is_needed() -> None:
    assert status() == 400
    assert status(HOST, HOST) == 400


@pytest.mark.parametrize(
    "origin",
    [b"http://attacker.test", b"null", b"https://127.0.0.1:4711", b"http://127.0.0.1:4712", b""],
)
def test_other_origins_are_refused(origin: bytes) -> None:
    assert status(HOST, (b"origin", origin)) == 403
    assert status(HOST, (b"origin", origin), TOKEN, OWN, path="/open", method="POST") == 403
    sent, _ = ask([HOST, (b"origin", origin)], type="websocket", path="/socket")
    assert sent == [{"type": "websocket.close"}]


def test_sockets_and_requests_that_change_something_need_an_origin() -> None:
    assert status(HOST, TOKEN, OWN, path="/open", method="POST") == 403
    assert ask([HOST], type="websocket", path="/socket")[0] == [{"type": "websocket.close"}]
    assert status(HOST, ORIGIN, TOKEN, OWN, path="/open", method="POST") == 200


@pytest.mark.parametrize("token", [b"", b"Bearer", b"Bearer 0", b"Basic " + DOOR.token.encode()])
def test_all_but_the_page_needs_the_token(token: bytes) -> None:
    assert status(HOST, (b"authorization", token), path="/files/1") == 401
    assert status(HOST, path="/files/1") == status(HOST, path="/anything") == 401
    assert status(HOST, TOKEN, path="/files/1") == 200


def test_a_post_needs_a_header_that_strangers_cannot_send() -> None:
    assert status(HOST, ORIGIN, TOKEN, path="/open", method="POST") == 403
    no = (b"x-armcontour", b"0")
    assert status(HOST, ORIGIN, TOKEN, no, path="/open", method="POST") == 403


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"])
def test_other_methods_are_refused(method: str) -> None:
    assert status(HOST, ORIGIN, TOKEN, OWN, path="/open", method=method) == 405


def test_large_bodies_are_refused_before_they_are_read() -> None:
    post = {"path": "/open", "method": "POST"}
    length = (b"content-length", str(LARGEST_UPLOAD + 1).encode())
    sent, read = ask([HOST, ORIGIN, TOKEN, OWN, length], **post)
    assert sent[0]["status"] == 413 and read == 0
    half = bytes(LARGEST_UPLOAD // 2 + 1)
    sent, read = ask([HOST, ORIGIN, TOKEN, OWN], body=[half, half, half], **post)
    assert sent[0]["status"] == 413 and read == len(half)


@pytest.mark.parametrize("headers", [[HOST], [], [HOST, (b"origin", b"null")]])
def test_every_answer_tells_the_browser_to_be_strict(headers: list[tuple[bytes, bytes]]) -> None:
    sent = dict(ask(headers)[0][0]["headers"])
    policy = sent[b"content-security-policy"].decode()
    assert "default-src 'none'" in policy and "unsafe" not in policy
    assert "connect-src 'self' ws://127.0.0.1:4711 ws://localhost:4711" in policy
    assert sent[b"x-content-type-options"] == b"nosniff"
    assert sent[b"referrer-policy"] == b"no-referrer"
    assert sent[b"cross-origin-resource-policy"] == b"same-origin"
    assert not any(b"access-control" in x for x in sent)


def test_tokens() -> None:
    first, second = make_token(), make_token()
    assert first != second and len(bytes.fromhex(first)) == 16
    door = Door(1)
    assert door.opens(door.token) and not door.opens(first)
    assert not any(
        door.opens(x) for x in (None, "", 3, door.token[:-1], "\ud800", "ä", [door.token])
    )
    assert door.token not in repr(door)
    assert door.page == f"http://127.0.0.1:1/#{door.token}"


def test_messages_come_at_a_rate_with_some_at_once() -> None:
    now = 0.0
    allowance = Allowance(lambda: now)
    assert sum(allowance.take() for _ in range(10_000)) == BURST
    now = 1.0
    assert sum(allowance.take() for _ in range(10_000)) == RATE
    now = 1e6
    assert sum(allowance.take() for _ in range(10_000)) == BURST
