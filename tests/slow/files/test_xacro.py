"""Xacro files that never end or take all memory."""

import sys

import pytest
from tests.files.robots.test_xacro import link, load, write

import armcontour as ac

ENDLESS = (
    "".join(
        f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>'
        for i in range(60)
    )
    + '<xacro:macro name="m60"><link name="x"/></xacro:macro><xacro:m0/>'
)


def test_time_is_limited(tmp_path, refuses, monkeypatch):
    monkeypatch.setattr("armcontour.files.robots.xacro_file.MAX_SECONDS", 2.0)
    refuses(lambda: load(write(tmp_path, ENDLESS)), ac.InvalidInput, "longer than 2 s")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="not every system limits memory")
def test_memory_is_limited(tmp_path, refuses):
    doubled = "".join(
        f'<xacro:property name="a{i}" value="${{a{i - 1} + a{i - 1}}}"/>' for i in range(1, 13)
    )
    first = '<xacro:property name="a0" value="${[0] * 100000}"/>'
    file = write(tmp_path, first + doubled + link("${len(a12)}"))
    refuses(lambda: load(file), ac.InvalidInput, "robot.xacro", "more memory than")
