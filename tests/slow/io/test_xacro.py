"""Xacro files that never end or take all memory, and the process that expands them."""

import os
import subprocess
import sys
import time
from pathlib import Path as FilePath

import pytest
from tests.io.robots.test_xacro import link, load, write

import armcontour as ac
from armcontour._xacro.expanding import expand_xacro

ENDLESS = (
    "".join(
        f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>'
        for i in range(60)
    )
    + '<xacro:macro name="m60"><link name="x"/></xacro:macro><xacro:m0/>'
)


def test_time_is_limited(tmp_path, refuses):
    file = write(tmp_path, ENDLESS)
    started = time.monotonic()
    refuses(lambda: expand_xacro(file, seconds=0.5), ac.InvalidInput, "longer than 0.5 s")
    assert time.monotonic() - started < 3
    assert os.listdir(tmp_path) == ["robot.xacro"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="not every system limits memory")
def test_memory_is_limited(tmp_path, refuses):
    doubled = "".join(
        f'<xacro:property name="a{i}" value="${{a{i - 1} + a{i - 1}}}"/>' for i in range(1, 13)
    )
    first = '<xacro:property name="a0" value="${[0] * 100000}"/>'
    file = write(tmp_path, first + doubled + link("${len(a12)}"))
    refuses(lambda: load(file), ac.InvalidInput, "robot.xacro", "more memory than")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_the_process_dies_with_its_parent(tmp_path):
    file = write(tmp_path, ENDLESS)
    program = (
        "from pathlib import Path; from armcontour._xacro.expanding import expand_xacro; "
        f"expand_xacro(Path({str(file)!r}), seconds=60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program])
    children = FilePath(f"/proc/{parent.pid}/task/{parent.pid}/children")

    def wait_for(done, seconds=20.0):
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end
            time.sleep(0.02)

    try:
        wait_for(lambda: children.read_text().split())
        (child,) = children.read_text().split()
        status = FilePath(f"/proc/{child}/stat")
        time.sleep(0.3)
        assert status.exists()
    finally:
        parent.kill()
        parent.wait()
    # It may stay as an entry without a process, Z, where nobody waits for it.
    wait_for(lambda: not status.exists() or status.read_text().split()[2] == "Z", 5.0)
