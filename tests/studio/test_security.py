"""Attacks on the server, by other web pages and by a page that has the token."""

import logging
import socket
from contextlib import suppress

import pytest
from tests.studio.running_studio import running
from tests.studio.session_pages import JOB
from websockets.exceptions import ConnectionClosed, InvalidStatus

from armcontour.core.errors import InvalidInput
from armcontour.studio import server
from armcontour.studio.access_control import MAX_UPLOAD
from armcontour.studio.tasks.dispatch import do

SECRET = "the-secret"
OPEN = ("POST", "/open?name=a.csv", b"1")


class Heard(logging.Handler):
    """All that is logged."""

    def __init__(self):
        super().__init__()
        self.lines = []

    def emit(self, record):
        # The other side of the sockets is in this process, too.
        if not record.name.startswith("websockets"):
            self.lines.append(f"{record.getMessage()} {record.exc_info}")


@pytest.fixture(scope="module")
def heard():
    handler = Heard()
    root = logging.getLogger()
    before = root.level
    root.addHandler(handler)
    root.setLevel(logging.DEBUG)
    yield handler
    root.removeHandler(handler)
    root.setLevel(before)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a job; the files next to the folder must not be readable."""
    outside = tmp_path_factory.mktemp("outside")
    inside = outside / "inside"
    inside.mkdir()
    (inside / "job.yaml").write_text(JOB)
    (outside / "secret.csv").write_text(f"x,y\n{SECRET},1\n")
    (outside / "secret.yaml").write_text(SECRET)
    (outside / "secret.urdf").write_text(f"<robot name='{SECRET}'>")
    (inside / "link.csv").symlink_to(outside / "secret.csv")
    (inside / "out").symlink_to(outside)
    return inside


@pytest.fixture(scope="module")
def studio(folder, heard):
    with running(folder / "job.yaml") as server:
        with server.page() as page:
            page.hear("executed")
        yield server


def refused(studio, **how):
    with pytest.raises(InvalidStatus) as caught, studio.socket(**how):
        pass
    return int(caught.value.response.status_code)


def closed(page, *messages):
    """Why a page is closed that sends some messages, whatever it hears before."""
    with suppress(ConnectionClosed):
        for message in messages:
            page.send(message)
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            page.recv()
    return caught.value.rcvd


def upgrade(studio, host, origin):
    """The answer to a request for a socket."""
    with socket.create_connection(("127.0.0.1", studio.port)) as raw:
        raw.sendall(
            f"GET /socket HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode()
        )
        return raw.recv(4096)


def refusal_of(studio, text):
    """Why a text is refused."""
    with studio.page() as page:
        seq = page.edit({"do": "text", "text": text})
        frame = page.hear("refusal", "document", seq=seq)
        if frame.kind == "document":
            assert frame.header["text"] == JOB, "it was not refused"
            frame = page.hear("refusal", seq=seq)
        return str(frame.header["sentence"])


def test_s1_to_s6_and_s14_forbidden_requests_are_refused(studio):
    for origin in ("http://attacker.test", None):
        assert refused(studio, origin=origin) == studio.request(*OPEN, Origin=origin)[0] == 403
    for host in (f"attacker.test:{studio.port}", f"127.0.0.1:{studio.port + 1}"):
        for origin in (f"http://{host}", studio.base):
            assert studio.request("GET", "/", Host=host, Origin=origin)[0] == 400, host
            assert upgrade(studio, host, origin).startswith(b"HTTP/1.1 403"), host
    for token in (None, "0" * 32):
        assert studio.request(*OPEN, token=token)[0] == 401
        assert studio.request("GET", "/files/0", token=token)[0] == 401
    assert studio.request("GET", "/files/0")[0] == 404
    assert studio.request(*OPEN, X_Armcontour=None)[0] == 403
    assert studio.request("OPTIONS", "/open")[0] == 405


def test_s3_requests_with_a_wrong_token_are_refused(studio, monkeypatch):
    for first in (
        '{"op": "hello"}',
        '{"op": "hello", "token": "0"}',
        '{"op": "hello", "token": null}',
        '{"op": "undo", "token": "TOKEN"}',
        '["hello", "TOKEN"]',
        "TOKEN",
        "[" * 100_000,
        '{"op": "hello", "token": NaN}',
        b"\x00\xff",
    ):
        greeting = first if isinstance(first, bytes) else first.replace("TOKEN", studio.token)
        with studio.socket() as page:
            assert closed(page, greeting).code == 1008, first[:40]
    monkeypatch.setattr(server, "HELLO_TIMEOUT", 0.05)
    with studio.socket() as page:
        assert closed(page).code == 1008


def test_s7_the_server_sends_no_files_by_address(studio):
    for path in (
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
    ):
        status, _, body = studio.request("GET", path)
        assert status == 404 and len(body) < 200, path


def test_s7_drawings_arms_and_obstacles_of_other_folders_are_refused(studio, folder):
    outside = folder.parent
    for file in (
        *("../secret.csv", "link.csv", "out/secret.csv", f"{outside}/secret.csv"),
        *(f"file://{outside}/secret.csv", "/etc/passwd", "/proc/self/environ"),
    ):
        message = refusal_of(studio, JOB.replace("points:", f"file: {file} #"))
        assert "extension" in message or "outside of" in message or "file" in message, file
        assert SECRET not in message and "root:" not in message, file
    (folder / "robot.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry>'
        '<mesh filename="package://p/secret.csv"/></geometry></collision></link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    for arm in (
        "../secret.urdf",
        "{file: ../secret.urdf}",
        "{file: out/secret.urdf}",
        "{name: ur5e, joint_limits: ../secret.yaml}",
        "{name: ur5e, srdf: ../secret.urdf}",
    ):
        assert SECRET not in refusal_of(studio, JOB.replace("arm: pmk3s", f"arm: {arm}")), arm
    assert SECRET not in refusal_of(studio, f"{JOB}scene: {{urdf: [{{file: ../secret.urdf}}]}}\n")
    # The process of tasks reads nothing there either.
    text = JOB.replace("points:", "file: ../secret.csv #")
    request = {"text": text, "folder": str(folder), "allowed": [str(folder)]}
    with pytest.raises(InvalidInput, match="outside of"):
        do("report", request, lambda step: None)


def test_s7_uploads_with_unsafe_names_are_refused(studio):
    names = ("../a.csv", "a/../b.csv", "%2e%2e%2fa.csv", ".csv", "..", "", "a%00.csv", "C:%5ca.csv")
    for name in names:
        status, message = studio.upload(name, b"x,y\n0.3,0.1\n0.4,0.1\n")
        assert status == 422 and message, name


def test_s7_logs_are_stored_separately_and_require_the_token(studio, folder):
    before = sorted(folder.rglob("*"))
    log = ("POST", "/open?log=1&name=a.csv", b"t,q1\n0,0\n")
    for token in (None, "0" * 32):
        assert studio.request(*log, token=token)[0] == 401
    for hostile in ({"Origin": "http://attacker.test"}, {"X_Armcontour": None}):
        assert studio.request(*log, **hostile)[0] == 403
    names = ("../a.csv", "%2e%2e%2fa.csv", ".csv", "a%00.csv", "C:%5ca.csv", "job.yaml", "a.csv.gz")
    for name in names:
        status, message = studio.upload(f"{name}&log=1", log[2])
        assert status == 422 and message, name
    assert studio.upload("a.csv&log=1", b"")[0] == 422
    with studio.page() as page:
        text = page.hear("document").header["text"]
        for content in (log[2], bytes(range(256)), b"<script>alert(1)</script>"):
            assert studio.upload("a.csv&log=1", content)[0] == 200
        # A log is no drawing of the job.
        shown = page.hear("document").header
        assert shown["text"] == text and not shown["undo_label"]
        for name in ("../job.yaml", str(folder / "job.yaml"), "/etc/passwd", {"a.csv": 1}):
            page.say("task", id="t", task="learn", options={"logs": [name]})
            assert "Drop it" in page.hear("failed").header["sentence"]
    assert sorted(folder.rglob("*")) == before


def test_s8_hostile_xml_is_refused(studio):
    # Each entity is ten of the one before: the last one has ten thousand million letters.
    pairs = zip("abcdefghi", "bcdefghij", strict=True)
    entities = "".join(f'<!ENTITY {y} "{f"&{x};" * 10}">' for x, y in pairs)
    bomb = f'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">{entities}]>'
    outside = '<!DOCTYPE a [<!ENTITY j SYSTEM "file:///etc/passwd">]>'
    for head in (outside, bomb, "<a" * 100_000):
        for kind, tag in (("svg", "svg"), ("urdf", "robot")):
            text = f'{head}<{tag} name="&j;"><text>&j;</text></{tag}>'
            status, message = studio.upload(f"a.{kind}", text.encode())
            assert status == 422 and "root:" not in message, (kind, head[:60])
    text = (
        '<svg xmlns="http://www.w3.org/2000/svg" onload="alert(1)" width="10mm" height="10mm">'
        "<script>alert(2)</script></svg>"
    )
    # Scripts are geometry or nothing.
    status, message = studio.upload("a.svg", text.encode())
    assert status == 422 and "alert" not in message
    assert studio.request("GET", "/static/a.svg")[0] == 404


def test_s9_hostile_yaml_is_refused(studio):
    # Unfolded, the first one has 9^11 items.
    rows = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    bomb = "\n".join(["a0: &a0 [x]", *rows])
    for text in (bomb, "[" * 1_000, "a: !!python/object/apply:os.system [ls]", "? " * 3_000):
        assert refusal_of(studio, text)
        assert studio.upload("a.yaml", text.encode())[0] == 422


def test_s9_excessive_sizes_are_refused(studio):
    size = str(MAX_UPLOAD + 1)
    for path, words in (
        ("/open?name=a.csv", b"64 MB"),
        ("/open?log=1&name=a.csv", b"armcontour learn"),
    ):
        status, _, body = studio.request("POST", path, Content_Length=size)
        assert status == 413 and b"64 MB" in body and words in body
    with studio.page() as page:
        closed(page.socket, "x" * (server.MAX_MESSAGE + 1))


def test_s11_the_server_listens_on_this_machine_only(studio):
    addresses = {x[4][0] for x in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Nothing is sent: this only chooses the interface that leads out.
            probe.connect(("192.0.2.1", 9))
            addresses.add(probe.getsockname()[0])
        except OSError:
            pass
    for address in {"127.0.0.2", "::1", *addresses} - {"127.0.0.1"}:
        with pytest.raises(OSError):
            socket.create_connection((address, studio.port)).close()


def test_s13_the_token_is_in_no_output(studio, heard, folder, capfd):
    for path in (f"/{studio.token}", f"/?token={studio.token}", f"/files/{studio.token}"):
        studio.request("GET", path, Referer=f"{studio.base}/?token={studio.token}")
    with socket.create_connection(("127.0.0.1", studio.port)) as raw:
        raw.sendall(f"no http {studio.token}\r\n\r\n".encode())
        raw.recv(4096)
    _, headers, page = studio.request("GET", "/")
    assert headers["referrer-policy"] == "no-referrer"
    texts = [page.decode(), *heard.lines, *capfd.readouterr(), *map(str, folder.rglob("*"))]
    assert not [x for x in texts if studio.token in x]
