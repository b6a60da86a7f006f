"""`armcontour init`: built-in cells as files, in which drawings run."""

import json

import pytest
from typer.testing import CliRunner

from armcontour.cli.commands import app
from armcontour.errors import InvalidInput
from armcontour.io.cell import cell_names

# A plate of 30 x 20 mm with its corner cut; millimetres, the pen down at z = 0.
DRAWING = "G21 G90 F1500\nG0 X5 Y5\nG1 X30 Y5\nG1 X30 Y20\nG1 X5 Y12\n"


def call(*arguments):
    done = CliRunner().invoke(app, arguments)
    assert done.exception is None or isinstance(done.exception, InvalidInput | SystemExit)
    said = done.output if done.exit_code == 0 else str(done.exception)
    return done.exit_code, " ".join(said.split())


@pytest.mark.parametrize("cell", cell_names())
def test_a_written_cell_runs_a_drawing(cell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said = call("init", cell)
    assert code == 0 and f"--cell {cell}.yaml" in said
    text = (tmp_path / f"{cell}.yaml").read_text()
    assert f"arm: {cell}\n" in text and text.count("#") > 5
    (tmp_path / "plate.ngc").write_text(DRAWING)
    line = ("run", "plate.ngc", "--cell", f"{cell}.yaml", "--out", "out", "--no-simulation")
    assert call(*line, "--scale", "0.5")[0] == 0
    run = json.loads((tmp_path / "out" / "summary.json").read_text())["runs"]["taught"]
    assert 0 < run["duration"] < 10


def test_a_cell_is_written_where_it_is_wanted_and_over_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("init", "-o", "shop.yaml")[0] == 0
    written = (tmp_path / "shop.yaml").read_text()
    assert "arm: ur5e\n" in written
    code, said = call("init", "panda", "-o", "shop.yaml")
    assert code != 0 and "shop.yaml is there already" in said and "--force" in said
    assert (tmp_path / "shop.yaml").read_text() == written
    assert call("init", "panda", "-o", "shop.yaml", "--force")[0] == 0
    assert "arm: panda\n" in (tmp_path / "shop.yaml").read_text()
    for arguments, words in (
        (("lathe",), "There is no cell 'lathe'"),
        (("ur5e", "-o", "cell.dxf"), "A cell is a .yaml file"),
        (("ur5e", "-o", "none/cell.yaml"), "Cannot write none/cell.yaml: "),
    ):
        code, said = call("init", *arguments)
        assert code != 0 and words in said
    assert [x.name for x in tmp_path.iterdir()] == ["shop.yaml"]
