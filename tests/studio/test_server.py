"""The server: start and end, files, and pages that join the session."""

import asyncio
import contextlib
import socket
from threading import Event

import pytest
from tests.studio.running_studio import running
from tests.studio.session_pages import MOVE

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import COMPILING, Step
from armcontour.report.message_frame import MessageFrame
from armcontour.studio import server
from armcontour.studio import session as session_module
from armcontour.studio.connection import OpenPage, SessionHost, open_session
from armcontour.studio.server import listen, require_server, serve


def test_a_page_exchanges_messages_with_the_session(file):
    with running(file) as studio, studio.page() as page, studio.page() as other:
        assert page.hear("document").header["name"] == "small"
        other.hear("executed")
        page.edit({"do": "set", "key": "corners.tolerance", "value": "4 mm"})
        assert "4 mm" in other.hear("document").header["undo_label"]
        tabs = studio.session_host.session.pages
        number = tabs.keep_file("a b.html", b"x")
        status, headers, body = studio.request("GET", f"/files/{number}")
        assert (status, body) == (200, b"x")
        assert headers["content-disposition"] == "attachment; filename*=UTF-8''a%20b.html"
        status, reply = studio.upload("part.csv", b"x [mm],y [mm]\n300,100\n350,120\n")
        assert (status, reply) == (200, "")
        assert other.hear("document").header["path"]["kind"] == "file"


def test_an_invalid_job_or_a_used_port_ends_the_server(tmp_path, monkeypatch):
    (tmp_path / "job.yaml").write_text("[")
    with pytest.raises(InvalidInput, match="job.yaml"):
        serve(lambda say: open_session(tmp_path / "job.yaml"), announce=lambda address: None)
    with listen(0) as taken:
        # Named, so that asyncio sends at once: header and body are two packets.
        assert taken.proto == socket.IPPROTO_TCP
        assert taken.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InvalidInput, match="Port .* cannot be used.*--port"):
            listen(taken.getsockname()[1])
    monkeypatch.setattr(server, "REQUIRED_LIBRARIES", ("uvicorn", "no_such_library"))
    with pytest.raises(InvalidInput, match=r"requires no_such_library.*armcontour\[studio\]"):
        require_server()


def test_silent_and_incomplete_connections_do_not_block_a_page(file):
    with running(file) as studio, contextlib.ExitStack() as closing:
        for k in range(220):
            half = closing.enter_context(socket.create_connection(("127.0.0.1", studio.port)))
            if k >= 20:
                half.sendall(b"GET / HTTP/1.1\r\nHost: ")
        for _ in range(5):
            assert studio.request("GET", "/")[0] == 200
        with studio.page() as page:
            page.hear("document")


def test_a_job_that_is_a_link_to_another_folder_is_watched_and_saved(file, tmp_path):
    target = tmp_path / "home" / "job.yaml"
    link = tmp_path / "link.yaml"
    target.parent.mkdir()
    target.write_text(file.read_text())
    link.symlink_to(target)
    with running(link) as studio, studio.page() as page:
        page.hear("executed")
        page.hear("document", seq=page.edit(MOVE))
        page.say("save")
        page.hear("saved")
        assert link.is_symlink() and target.read_text() != file.read_text()


def test_slow_pages_receive_the_newest_state():
    async def talk():
        tab = OpenPage()
        sent = []
        for k in range(100):
            tab.send(b"%d" % k, "picture")
        tab.send(b"notice")
        tab.send(b"again", "picture")

        async def send(message):
            sent.append(message["bytes"])

        writing = asyncio.create_task(tab.write(send))
        while len(sent) < 2:
            await asyncio.sleep(0)
        writing.cancel()
        return sent

    assert asyncio.run(talk()) == [b"notice", b"again"]


def test_pages_that_open_before_the_session_join_it(session):
    async def talk():
        session_host = SessionHost(lambda say: session)
        tab = OpenPage()
        session_host.join(tab)
        session_host.receive(tab, {"op": "nonsense", "id": 0})
        session_host.start()
        session_host.receive(tab, {"op": "nonsense", "id": 1})
        session_host.leave(tab)
        assert session_host.pages == [] and session_host.failure is None
        frames = [MessageFrame.unpack(x) for x in tab._waiting.values()]
        assert "document" in [x.kind for x in frames]
        return [x.header["id"] for x in frames if x.kind == "failed"]

    assert asyncio.run(talk()) == [1]


def test_a_page_that_opens_during_the_compilation_hears_how_far_it_is(file, monkeypatch):
    entered = Event()
    released = Event()

    @contextlib.contextmanager
    def compile_slowly(dimension, progress):
        """Report a quarter of the compilation, and wait."""
        for name, share in (("2 functions", 0.0), ("first", 0.25)):
            progress(Step((COMPILING, name), share))
        entered.set()
        released.wait()
        yield

    monkeypatch.setattr(session_module, "compile_for_run", compile_slowly)
    with running(file) as studio:
        try:
            entered.wait()
            with studio.page() as page:
                header = page.hear("progress").header
                while header["share"] != 0.25:
                    header = page.hear("progress").header
                assert header["steps"][0] == COMPILING
                # Three quarters are left, which take three times as long.
                assert header["left"] == pytest.approx(3 * header["spent"], rel=0.5, abs=0.01)
                released.set()
                page.hear("picture")
                while header.get("state") != "done" or header["task"] != "start":
                    header = page.hear("progress").header
        finally:
            released.set()
