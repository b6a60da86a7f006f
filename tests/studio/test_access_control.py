"""Access to the Studio: hosts, origins, tokens and sizes of requests."""

import asyncio

import numpy as np
import pytest

from armcontour.files import parse_job
from armcontour.report.arm_frame import arm_frame
from armcontour.studio.access_control import (
    MAX_UPLOAD,
    AccessControl,
    Endpoint,
    make_token,
    respond,
)

DOOR = Endpoint(4711, "0123456789abcdef0123456789abcdef")
HOST = (b"host", b"127.0.0.1:4711")
ORIGIN = (b"origin", b"http://127.0.0.1:4711")
TOKEN = (b"authorization", b"Bearer " + DOOR.token.encode())
OWN = (b"x-armcontour", b"1")
POST = {"path": "/open", "method": "POST"}
OTHER_HOSTS = (b"attacker.test:4711", b"127.0.0.1", b"127.0.0.1:4712", b"[::1]:4711",
               b"127.0.0.1:4711.a", b"")  # fmt: skip
OTHER_ORIGINS = (b"http://attacker.test", b"null", b"https://127.0.0.1:4711",
                 b"http://127.0.0.1:4712", b"")  # fmt: skip


def ask(headers, *, path="/", method="GET", type="http", body=None):
    """What the guard answers, and how many bytes of the body came through to the app."""
    parts = list(body or [b""])
    sent = []
    read = 0

    async def receive():
        return {"type": "http.request", "body": parts.pop(0), "more_body": bool(parts)}

    async def send(message):
        sent.append(message)

    async def app(scope, receive, send):
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
    asyncio.run(AccessControl(app, DOOR)(scope, receive, send))
    return sent, read


def status(*headers, **how):
    return int(ask(list(headers), **how)[0][0]["status"])


def socket(*headers):
    return ask(list(headers), type="websocket", path="/socket")[0]


CLOSED = [{"type": "websocket.close"}]


def test_requests_require_the_host_of_this_machine():
    assert status(HOST) == status((b"Host", b"localhost:4711")) == 200
    assert status(HOST, path="/static/app.js", method="HEAD") == 200
    assert status() == status(HOST, HOST) == 400
    for host in OTHER_HOSTS:
        assert status((b"host", host)) == 400, host
        assert status((b"host", host), (b"origin", b"http://" + host)) == 400, host


def test_changes_and_sockets_require_the_same_origin():
    assert status(HOST, ORIGIN) == 200
    for origin in OTHER_ORIGINS:
        other = (b"origin", origin)
        assert status(HOST, other) == 403, origin
        assert status(HOST, other, TOKEN, OWN, **POST) == 403, origin
        assert socket(HOST, other) == CLOSED, origin
    assert status(HOST, TOKEN, OWN, **POST) == 403
    assert socket(HOST) == CLOSED and socket(HOST, ORIGIN) != CLOSED
    assert status(HOST, ORIGIN, TOKEN, OWN, (b"content-length", b"1"), **POST) == 200


def test_every_request_except_for_the_page_requires_the_token():
    for token in (b"", b"Bearer", b"Bearer 0", b"Basic " + DOOR.token.encode()):
        assert status(HOST, (b"authorization", token), path="/files/1") == 401, token
    assert status(HOST, path="/files/1") == status(HOST, path="/anything") == 401
    assert status(HOST, TOKEN, path="/files/1") == 200
    assert status(HOST, ORIGIN, TOKEN, **POST) == 403
    assert status(HOST, ORIGIN, TOKEN, (b"x-armcontour", b"0"), **POST) == 403
    for method in ("PUT", "DELETE", "OPTIONS", "TRACE", "PATCH"):
        assert status(HOST, ORIGIN, TOKEN, OWN, path="/open", method=method) == 405, method


def test_large_bodies_are_refused_before_they_are_read():
    length = (b"content-length", str(MAX_UPLOAD + 1).encode())
    for more in ([length], [], [(b"content-length", b"x")]):
        sent, read = ask([HOST, ORIGIN, TOKEN, OWN, *more], **POST)
        assert sent[0]["status"] == 413 and read == 0


@pytest.mark.parametrize("headers", [[HOST], [], [HOST, (b"origin", b"null")]])
def test_every_answer_has_headers_for_strict_browsers(headers):
    sent = dict(ask(headers)[0][0]["headers"])
    policy = sent[b"content-security-policy"].decode()
    assert "default-src 'none'" in policy and "unsafe" not in policy
    assert "connect-src 'self' ws://127.0.0.1:4711 ws://localhost:4711" in policy
    assert "frame-ancestors 'none'" in policy
    assert sent[b"x-content-type-options"] == b"nosniff"
    assert sent[b"referrer-policy"] == b"no-referrer"
    assert sent[b"cross-origin-resource-policy"] == b"same-origin"
    assert not any(b"access-control" in x for x in sent)


def test_tokens_are_random_and_never_printed():
    first, second = make_token(), make_token()
    assert first != second and len(bytes.fromhex(first)) == 16
    endpoint = Endpoint(1)
    assert endpoint.accepts(endpoint.token) and not endpoint.accepts(first)
    for token in (None, "", 3, endpoint.token[:-1], "\ud800", "ä", [endpoint.token]):
        assert not endpoint.accepts(token)
    assert endpoint.token not in repr(endpoint)
    assert endpoint.page == f"http://127.0.0.1:1/#{endpoint.token}"


SCENE = """
name: cell
arm: {name: ur5e, work: {position: [0.4, 0, 0.1]}}
path: {points: [[0, 0, 0], [0.1, 0, 0]], orientation: {axis: [0, 0, -1]}}
scene:
  obstacles:
    - {type: box, name: vice, size: [0.1, 0.1, 0.05], at: [0, 0, 50 mm], fixed_to: part}
    - {type: halfspace, name: table, at: [0.2, 0, -20 mm]}
servo: {kp: 25, kv: 150}
runs: {one: {}}
"""


def test_obstacles_are_drawn_in_the_frame_of_the_base():
    frame = arm_frame(parse_job(SCENE))
    bodies = {x["name"]: x for x in frame.header["bodies"]}
    vice = bodies["vice"]
    table = bodies["table"]
    assert (vice["link"], vice["colour"], table["colour"]) == (0, "part", "table")
    np.testing.assert_allclose(np.array(vice["at"])[:3, 3], [0.4, 0, 0.15], atol=1e-12)
    corners = frame.arrays[table["triangles"]].reshape(-1, 3) @ np.array(table["at"])[:3, :3].T
    corners = corners + np.array(table["at"])[:3, 3]
    # Its top is the plane, and it reaches around the arm.
    assert corners[:, 2].max() == pytest.approx(-0.02, abs=1e-6)
    assert corners[:, :2].min() == pytest.approx(-corners[:, :2].max(), abs=1e-6)
    assert corners[:, 0].max() > 1.0
