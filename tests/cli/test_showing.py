"""The command `show`: what a drawing consists of, before any arm."""

import json
from pathlib import Path as FilePath

import pytest
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.errors import InvalidInput

GASKET = FilePath(__file__).parents[2] / "examples" / "drawings" / "gasket.dxf"


def show(*arguments):
    done = CliRunner().invoke(app, ["show", *map(str, arguments)])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.output


def test_prints_or_chooses_layers_contours_and_size():
    said = show(GASKET)
    assert "140.00 x 122.50 mm" in said
    words = {x.strip() for line in said.splitlines() for x in line.split("│")}
    assert {"MARK", "CUT", "895.06", "7: handle 37", "52.00 x 52.00", "closed, cw"} <= words
    data = json.loads(show(GASKET, "--layer", "CUT", "--scale", 2, "--json"))
    assert list(data["layers"]) == ["CUT"] and len(data["contours"]) == 8
    assert data["layers"]["CUT"]["length"] == pytest.approx(2 * 0.89506, abs=1e-4)
    assert [x["inside"] for x in data["contours"]] == [8] * 7 + [None]
    size = [b - a for a, b in zip(*data["extent"], strict=True)]
    assert size == pytest.approx([0.28, 0.245], abs=1e-12)


def test_tools_have_diameters(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text("F600\nG41 D1 G1 X10\nG42.1\n")
    with pytest.raises(InvalidInput, match="--tool '1: 3 mm'"):
        show(file)
    file.write_text("F600\nG41 D2 G1 X10\nX20\nM2\n")
    data = json.loads(show(file, "--tool", "1: 3 mm, 2:4mm", "--json"))
    assert data["extent"][1] == pytest.approx([0.02, 2e-3])
    for text in ("3 mm", "x: 3 mm", "1: 3", "1: 3 mm, 1: 4 mm", "123456789: 1 mm"):
        with pytest.raises(InvalidInput, match="--tool"):
            show(file, "--tool", text)
