"""The server's start and end, and what it gives."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from tests.studio.serving import running
from tests.studio.talking import JOB, MOVE

from armcontour.errors import InvalidInput
from armcontour.studio import server
from armcontour.studio.server import MOST_CONNECTIONS, listen, require_server, serve


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("studio") / "job.yaml"
    place.write_text(JOB)
    return place


def test_a_page_talks_with_the_session(file: Path) -> None:
    with running(file) as studio, studio.page() as page, studio.page() as other:
        assert page.hear("document").header["name"] == "small"
        other.hear("executed")
        page.edit({"do": "set", "key": "corners.tolerance", "value": "4 mm"})
        assert other.hear("document").header["undo_label"] == "set tolerance"
        assert studio.desk.session is not None
        tabs = studio.desk.session.display.tabs
        number = tabs.keep_file("a b.html", "text/html", b"x")
        status, headers, body = studio.request("GET", f"/files/{number}")
        assert (status, body) == (200, b"x")
        assert headers["content-disposition"] == "attachment; filename*=UTF-8''a%20b.html"
        status, told = studio.upload("part.csv", b"x [mm],y [mm]\n300,100\n350,120\n")
        assert (status, told) == (200, "")
        assert other.hear("document").header["path"]["kind"] == "file"


def test_answers_do_not_wait_for_the_acknowledgement_of_what_was_sent_before() -> None:
    # Header and body are two packets; a frame is several.
    found: list[int] = []

    async def look() -> None:
        done = asyncio.Event()

        async def meet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            there = writer.get_extra_info("socket")
            found.append(there.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()
            done.set()

        serving = await asyncio.start_server(meet, sock=listen(0))
        async with serving:
            _, writer = await asyncio.open_connection(*serving.sockets[0].getsockname())
            await done.wait()
            writer.close()

    asyncio.run(look())
    assert found and all(found)


def test_a_page_that_comes_while_it_starts_waits(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tests.studio import serving

    started, go_on = threading.Event(), threading.Event()

    def slowly(*args: Any, say: Any, **how: Any) -> Any:
        from armcontour.studio.opening import open_session

        session = open_session(*args, say=say, **how)
        started.set()
        go_on.wait(20)
        return session

    monkeypatch.setattr(serving, "open_session", slowly)
    with running(file) as studio:
        assert started.wait(20)
        with studio.page() as page:
            progress = page.hear("progress").header
            assert progress["id"] == "start" and progress["steps"]
            assert studio.upload("a.csv", b"1")[0] == 503
            go_on.set()
            assert page.hear("document").header["rev"] == 1


def test_the_end_after_the_last_page(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.studio.serving import Running
    from tests.studio.talking import NoLane

    from armcontour.studio.opening import open_session

    monkeypatch.setattr(server, "CLOSED_FOR", 0.1)
    found: list[Any] = []

    def work() -> None:
        serve(
            lambda say: open_session(file, say=say, slow=NoLane),
            announce=found.append,
            opened=found.append,
            exit_when_closed=True,
        )

    thread = threading.Thread(target=work)
    thread.start()
    while len(found) < 2:
        thread.join(0.01)
    thread.join(0.5)
    assert thread.is_alive(), "no page was open yet"
    with Running(*found).page() as page:
        page.hear("document")
        thread.join(0.5)
        assert thread.is_alive()
    thread.join(20)
    assert not thread.is_alive()


def test_what_cannot_be_opened_ends_the_server(tmp_path: Path) -> None:
    from armcontour.studio.opening import open_session

    (tmp_path / "job.yaml").write_text("[")
    with pytest.raises(InvalidInput, match="job.yaml"):
        serve(lambda say: open_session(tmp_path / "job.yaml"), announce=lambda address: None)


def test_a_port_that_is_taken() -> None:
    with listen(0) as taken:
        assert taken.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InvalidInput, match="Port .* cannot be used.*--port"):
            listen(taken.getsockname()[1])


def test_missing_libraries_are_named_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "NEEDED", ("uvicorn", "no_such_library"))
    with pytest.raises(InvalidInput, match=r"needs no_such_library: .*armcontour\[studio\]"):
        require_server()


def test_a_connection_that_says_nothing_costs_nothing(file: Path) -> None:
    with running(file) as studio:
        idle = [socket.create_connection(("127.0.0.1", studio.port)) for _ in range(20)]
        assert studio.request("GET", "/")[0] == 200
        for x in idle:
            x.close()


SERVING = """
import gc
import os
import threading
import time

import numpy as np

from armcontour.studio.server import serve

PAGE = os.sysconf("SC_PAGE_SIZE")


def used():
    with open("/proc/self/statm") as told:
        return int(told.read().split()[1]) * PAGE / 2**20


class Session:
    def begin(self):
        threading.Thread(target=work, daemon=True).start()

    def look(self):
        pass

    def close(self):
        pass


def work():
    while not gc.get_freeze_count():
        time.sleep(0.01)
    # Executions of a long motion, and what is kept of a short one that follows.
    del [np.ones(3 * 2**20)][0]
    before = used()
    many = [np.ones(2**20) for _ in range(20)]
    kept = bytes(2**16)
    most = used()
    del many
    print(before, most, used(), gc.get_freeze_count(), flush=True)
    desks[0].stop()


desks = []
serve(lambda say: Session(), announce=lambda address: None, opened=desks.append)
print(gc.get_freeze_count())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other C libraries give memory back otherwise")
def test_memory_of_executions_goes_back_and_what_is_loaded_is_no_garbage() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SERVING], capture_output=True, text=True, timeout=60, check=True
    )
    told, frozen_after = done.stdout.splitlines()
    before, most, after, frozen = map(float, told.split())
    assert most - before > 100
    assert after - before < 40
    assert frozen > 10_000 and frozen_after == "0"


def test_requests_that_are_never_whole_stop_no_page(file: Path) -> None:
    with running(file) as studio, contextlib.ExitStack() as closing:
        for _ in range(2 * MOST_CONNECTIONS):
            half = socket.create_connection(("127.0.0.1", studio.port))
            closing.enter_context(half)
            half.sendall(b"GET / HTTP/1.1\r\nHost: ")
        for _ in range(5):
            assert studio.request("GET", "/")[0] == 200
        with studio.page() as page:
            page.hear("document")


def test_a_job_that_is_a_link_to_another_folder_is_watched_and_saved(
    file: Path, tmp_path: Path
) -> None:
    target, link = tmp_path / "home" / "job.yaml", tmp_path / "job.yaml"
    target.parent.mkdir()
    target.write_text(file.read_text())
    link.symlink_to(target)
    with running(link) as studio, studio.page() as page:
        page.hear("executed")
        page.hear("document", seq=page.edit(MOVE))
        page.say("save")
        page.hear("saved")
        assert link.is_symlink() and target.read_text() != file.read_text()
