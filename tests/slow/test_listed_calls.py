"""The list of compiled functions covers what usual work calls."""

from __future__ import annotations

import signal
import sys

import pytest
from tools.kernels import unlisted

from armcontour.cli import main

WORK = (
    ["demo", "--out", "demo"],
    ["run", "{drawings}/gasket.dxf", "--cell", "ur10e", "--out", "gasket"],
    ["run", "{drawings}/lettering.svg", "--cell", "pmk3s", "--out", "lettering"],
    ["run", "{drawings}/gasket.dxf", "--cell", "{drawings}/gentle.yaml", "--out", "gentle"],
    ["run", "{drawings}/pocket.ngc", "--cell", "pmk3s", "--ignore-z", "--out", "pocket"],
    [
        "place",
        "{drawings}/gasket.dxf",
        "--cell",
        "ur5e",
        "--x",
        "0 m .. 0.1 m, 2",
        "--out",
        "place",
    ],
)


def test_the_list_of_kernels_covers_usual_work(tmp_path, monkeypatch, pytestconfig):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    drawings = str(pytestconfig.rootpath / "examples" / "drawings")
    for line in WORK:
        arguments = [x.format(drawings=drawings) for x in line]
        monkeypatch.setattr(sys, "argv", ["armcontour", *arguments])
        monkeypatch.setattr(sys, "path", sys.path[:])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, line
    missing = "\n".join(sorted(unlisted()))
    assert not missing, f"Run `make kernels`: the list of compiled functions lacks\n{missing}"
