"""A server that is attacked: by other pages of the web, and by a page that has the token.

The numbers S1 to S14 are those of the list in docs/develop/studio.md.
"""

from __future__ import annotations

import json
import logging
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.studio.serving import Running, running
from tests.studio.talking import JOB
from websockets.exceptions import ConnectionClosed, InvalidStatus

from armcontour.errors import InvalidInput
from armcontour.studio import guard, server
from armcontour.studio.guard import LARGEST_UPLOAD
from armcontour.studio.tasks.working import do

SECRET = "the-secret"


class Heard(logging.Handler):
    """All that is logged."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        # The other side of the sockets is in this process, too.
        if not record.name.startswith("websockets"):
            self.lines.append(f"{record.getMessage()} {record.exc_info}")


@pytest.fixture(scope="module")
def heard() -> Iterator[Heard]:
    found, root = Heard(), logging.getLogger()
    before = root.level
    root.addHandler(found)
    root.setLevel(logging.DEBUG)
    yield found
    root.removeHandler(found)
    root.setLevel(before)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a job, and beside it what the page must not read."""
    outside = tmp_path_factory.mktemp("outside")
    inside = outside / "inside"
    inside.mkdir()
    (inside / "job.yaml").write_text(JOB)
    (outside / "secret.csv").write_text(f"x,y\n{SECRET},1\n")
    (outside / "secret.yaml").write_text(SECRET)
    (outside / "secret.urdf").write_text(f"<robot name='{SECRET}'>")
    (inside / "link.csv").symlink_to(outside / "secret.csv")
    (inside / "out").symlink_to(outside)
    (inside / "robot.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x"/>'
    )
    return inside


@pytest.fixture(scope="module")
def studio(folder: Path, heard: Heard) -> Iterator[Running]:
    with running(folder / "job.yaml") as found:
        with found.page() as page:
            page.hear("executed")
        yield found


def refused(studio: Running, **how: Any) -> int:
    """The status with which a socket is refused."""
    with pytest.raises(InvalidStatus) as caught, studio.socket(**how):
        pass
    return int(caught.value.response.status_code)


def test_s1_another_origin(studio: Running) -> None:
    for origin in ("http://attacker.test", "null", f"https://{studio.host}"):
        assert refused(studio, origin=origin) == 403
        assert studio.request("POST", "/open?name=a.csv", b"1", Origin=origin)[0] == 403
        assert studio.request("GET", "/", Origin=origin)[0] == 403


def test_s2_no_origin(studio: Running) -> None:
    assert refused(studio, origin=None) == 403
    assert studio.request("POST", "/open?name=a.csv", b"1", Origin=None)[0] == 403


@pytest.mark.parametrize(
    "first",
    [
        '{"op": "hello"}',
        '{"op": "hello", "token": "0"}',
        '{"op": "hello", "token": null}',
        '{"op": "undo", "token": "TOKEN"}',
        '["hello", "TOKEN"]',
        "TOKEN",
        "[" * 100_000,
        '{"op": "hello", "token": NaN}',
        b"\x00\xff",
    ],
)
def test_s3_no_token(studio: Running, first: str | bytes) -> None:
    said = first if isinstance(first, bytes) else first.replace("TOKEN", studio.token)
    with studio.socket() as socket:
        socket.send(said)
        with pytest.raises(ConnectionClosed) as caught:
            socket.recv(timeout=10)
    assert caught.value.rcvd is not None and caught.value.rcvd.code == 1008


def test_s3_silence(studio: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "HELLO_WITHIN", 0.05)
    with studio.socket() as socket, pytest.raises(ConnectionClosed):
        socket.recv(timeout=10)


def test_s3_no_token_for_files(studio: Running) -> None:
    for token in (None, "0" * 32):
        assert studio.request("POST", "/open?name=a.csv", b"1", token=token)[0] == 401
        assert studio.request("GET", "/files/0", token=token)[0] == 401
    assert studio.request("GET", "/files/0")[0] == 404


@pytest.mark.parametrize("name", ["attacker.test", "127.0.0.1.nip.io", "[::1]", "0.0.0.0"])
def test_s4_s5_another_host_even_if_the_origin_is_the_same(studio: Running, name: str) -> None:
    host = f"{name}:{studio.port}"
    for origin in (f"http://{host}", studio.base):
        assert studio.request("GET", "/", Host=host, Origin=origin)[0] == 400
        assert studio.request("POST", "/open?name=a", b"1", Host=host, Origin=origin)[0] == 400
        assert _upgrade(studio, host, origin).startswith(b"HTTP/1.1 403")


def test_s6_another_port(studio: Running) -> None:
    for host in ("127.0.0.1", f"127.0.0.1:{studio.port + 1}", "localhost:80"):
        assert studio.request("GET", "/", Host=host)[0] == 400
        assert _upgrade(studio, host, studio.base).startswith(b"HTTP/1.1 403")


def _upgrade(studio: Running, host: str, origin: str) -> bytes:
    """The answer to a request for a socket."""
    with socket.create_connection(("127.0.0.1", studio.port), timeout=10) as raw:
        raw.sendall(
            f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        return raw.recv(4096)


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py",
        "/static/..%2fserver.py",
        "/static/%2e%2e/server.py",
        "/static//etc/passwd",
        "/static/vendor",
        "/static/",
        "/static/vendor/three.d.ts",
        "/../../etc/passwd",
        "//etc/passwd",
        "/files/../job.yaml",
        "/static/index.html%00.js",
    ],
)
def test_s7_no_files_by_address(studio: Running, path: str) -> None:
    status, _, body = studio.request("GET", path)
    assert status == 404 and len(body) < 200


@pytest.mark.parametrize(
    "file",
    [
        "../secret.csv",
        "link.csv",
        "out/secret.csv",
        "{outside}/secret.csv",
        "file://{outside}/secret.csv",
        "/etc/passwd",
        "/proc/self/environ",
    ],
)
def test_s7_no_drawings_elsewhere(studio: Running, folder: Path, file: str) -> None:
    name = file.format(outside=folder.parent)
    told = _refusal_of(studio, JOB.replace("points:", f"file: {name} #"))
    assert "is not in" in told or "file" in told
    assert SECRET not in told and "root:" not in told


@pytest.mark.parametrize(
    "arm",
    [
        "../secret.urdf",
        "{file: ../secret.urdf}",
        "{file: out/secret.urdf}",
        "{name: ur5e, joint_limits: ../secret.yaml}",
        "{file: robot.urdf, packages: {p: ..}}",
        "{name: ur5e, srdf: ../secret.urdf}",
    ],
)
def test_s7_no_arms_elsewhere(studio: Running, folder: Path, arm: str) -> None:
    mesh = '<mesh filename="package://p/secret.csv"/>'
    (folder / "robot.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry>'
        f"{mesh}</geometry></collision></link>"
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    told = _refusal_of(studio, JOB.replace("arm: pmk3s", f"arm: {arm}"))
    assert SECRET not in told


def test_s7_no_obstacles_elsewhere(studio: Running) -> None:
    told = _refusal_of(studio, f"{JOB}scene: {{urdf: [{{file: ../secret.urdf}}]}}\n")
    assert SECRET not in told


@pytest.mark.parametrize(
    "name", ["../a.csv", "a/../b.csv", "%2e%2e%2fa.csv", ".csv", "..", "", "a%00.csv", "C:%5ca.csv"]
)
def test_s7_uploads_have_plain_names(studio: Running, name: str) -> None:
    status, told = studio.upload(name, b"x,y\n0.3,0.1\n0.4,0.1\n")
    assert status == 422 and told


def _refusal_of(studio: Running, text: str) -> str:
    """Why a text is refused."""
    with studio.page() as page:
        seq = page.edit({"do": "text", "text": text})
        frame = page.hear("refusal", "document", seq=seq)
        if frame.kind == "document":
            assert frame.header["text"] == JOB, "it was not refused"
            frame = page.hear("refusal", seq=seq)
        return str(frame.header["sentence"])


PAIRS = zip("abcdefghi", "bcdefghij", strict=True)
ENTITIES = [f'<!ENTITY {y} "{f"&{x};" * 10}">' for x, y in PAIRS]
BOMB = f'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">{"".join(ENTITIES)}]>'


@pytest.mark.parametrize("kind", ["svg", "urdf"])
@pytest.mark.parametrize(
    "head", ['<!DOCTYPE a [<!ENTITY j SYSTEM "file:///etc/passwd">]>', BOMB, "<a" * 100_000]
)
def test_s8_hostile_xml(studio: Running, kind: str, head: str) -> None:
    tag = "svg" if kind == "svg" else "robot"
    text = f'{head}<{tag} name="&j;"><text>&j;</text></{tag}>'
    begin = time.process_time()
    status, told = studio.upload(f"a.{kind}", text.encode())
    assert time.process_time() - begin < 5.0
    assert status == 422 and "root:" not in told


def test_s8_scripts_are_geometry_or_nothing(studio: Running) -> None:
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" onload="alert(1)" width="10mm" height="10mm">'
        "<script>alert(2)</script></svg>"
    )
    status, told = studio.upload("a.svg", text.encode())
    assert status == 422 and "alert" not in told
    assert studio.request("GET", "/static/a.svg")[0] == 404


def test_s9_hostile_yaml(studio: Running) -> None:
    rows = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    bomb = "\n".join(["a0: &a0 [x]", *rows])
    begin = time.process_time()
    for text in (bomb, "[" * 10_000, "a: !!python/object/apply:os.system [ls]", "? " * 3_000):
        assert _refusal_of(studio, text)
        assert studio.upload("a.yaml", text.encode())[0] == 422
    assert time.process_time() - begin < 10.0


def test_s9_large_files(studio: Running) -> None:
    status, _, body = studio.request(
        "POST", "/open?name=a.csv", Content_Length=str(LARGEST_UPLOAD + 1)
    )
    assert status == 413 and b"64 MB" in body


def test_s9_large_messages(studio: Running) -> None:
    with studio.page() as page, pytest.raises(ConnectionClosed):
        page.socket.send("x" * (server.LARGEST_MESSAGE + 1))
        page.hear("never")


def test_s9_many_messages(studio: Running, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "BURST", 20.0)
    monkeypatch.setattr(guard, "RATE", 1.0)
    with studio.page() as page, pytest.raises(ConnectionClosed) as caught:
        for _ in range(30):
            page.socket.send('{"op":"pose","t":0,"of":"planned"}')
        page.hear("never")
    assert caught.value.rcvd is not None and "too many" in caught.value.rcvd.reason


def test_s9_many_pages(studio: Running) -> None:
    from contextlib import ExitStack

    with ExitStack() as many, pytest.raises(ConnectionClosed):
        for _ in range(server.MOST_TABS + 1):
            page = many.enter_context(studio.page())
            page.hear("document")
    with studio.page() as page:
        page.hear("document")


@pytest.mark.parametrize("path", ["/", "/static/app.js", "/static/none", "/files/0", "/other"])
def test_s10_strict_headers(studio: Running, path: str) -> None:
    _, headers, _ = studio.request("GET", path)
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert "server" not in headers and "set-cookie" not in headers
    assert not any(x.startswith("access-control") for x in headers)


def test_s10_the_page_has_no_inline_code(studio: Running) -> None:
    page = studio.request("GET", "/", token=None)[2].decode()
    assert "<script>" not in page and " style=" not in page and " on" + "click" not in page


def test_s11_this_machine_only(studio: Running) -> None:
    own = {"127.0.0.2", *_addresses()} - {"127.0.0.1"}
    for address in own:
        with pytest.raises(OSError):
            socket.create_connection((address, studio.port), timeout=2).close()
    with pytest.raises(OSError):
        socket.create_connection(("::1", studio.port), timeout=2).close()


def _addresses() -> set[str]:
    """Addresses of this machine."""
    found = {x[4][0] for x in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Nothing is sent: this only chooses the interface that leads out.
            probe.connect(("192.0.2.1", 9))
            found.add(probe.getsockname()[0])
        except OSError:
            pass
    return {str(x) for x in found}


@pytest.mark.parametrize("arm", ["robot.xacro", "{file: robot.xacro}", "{file: ./ROBOT.XACRO}"])
def test_s12_no_programs(studio: Running, arm: str) -> None:
    told = _refusal_of(studio, JOB.replace("arm: pmk3s", f"arm: {arm}"))
    assert "is a program" in told
    with studio.page() as page:
        value = {"file": "robot.xacro"}
        seq = page.say(
            "edit", gesture=1, final=False, edits=[{"do": "set", "key": "arm", "value": value}]
        )
        assert page.hear("refusal", seq=seq).header["sentence"]
    assert studio.upload("a.xacro", b"<robot/>")[0] == 422
    assert studio.upload("a.j2", b"{{ 1 }}")[0] == 422


def test_s14_a_post_that_any_page_could_send(studio: Running) -> None:
    for header in (None, "", "0", "true"):
        assert studio.request("POST", "/open?name=a.csv", b"1", X_Armcontour=header)[0] == 403
    assert studio.request("OPTIONS", "/open")[0] == 405


def test_what_is_allowed_works_after_all_that(studio: Running, folder: Path) -> None:
    with studio.page() as page:
        page.hear("document")
        seq = page.edit({"do": "set", "key": "corners.tolerance", "value": "4 mm"})
        assert page.hear("executed", seq=seq).header["run"] == "slow"
        seq = page.say("undo")
        assert page.hear("document", seq=seq).header["text"] == JOB
    assert [x.name for x in folder.iterdir() if x.suffix == ".csv"] == ["link.csv"]
    assert (folder / "job.yaml").read_text() == JOB


def test_s13_the_token_is_nowhere(
    studio: Running, heard: Heard, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for path in (f"/{studio.token}", f"/?token={studio.token}", f"/files/{studio.token}"):
        studio.request("GET", path, Referer=f"{studio.base}/?token={studio.token}")
    with socket.create_connection(("127.0.0.1", studio.port), timeout=10) as raw:
        raw.sendall(f"no http {studio.token}\r\n\r\n".encode())
        raw.recv(4096)
    _, headers, page = studio.request("GET", "/")
    assert headers["referrer-policy"] == "no-referrer"
    assert studio.token not in page.decode()
    assert not [x for x in heard.lines if studio.token in x]
    assert studio.token not in "".join(capfd.readouterr())
    assert studio.token not in json.dumps([str(x) for x in folder.rglob("*")])


def test_s7_the_other_process_reads_no_files_elsewhere(folder: Path) -> None:
    text = JOB.replace("points:", "file: ../secret.csv #")
    request = {"text": text, "folder": str(folder), "allowed": [str(folder)]}
    with pytest.raises(InvalidInput, match="is not in"):
        do("check", request, lambda step: None)
