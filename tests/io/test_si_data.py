"""Data of files in SI units: what readers make of it, and the quantities of keys."""

from __future__ import annotations

from dataclasses import asdict
from importlib import resources

import pytest

from armcontour._yaml import load
from armcontour.io.cell import cell_data, cell_names, cell_text
from armcontour.io.job_model import CellModel
from armcontour.io.json_text import plain
from armcontour.io.keys import Keys, read_keys
from armcontour.io.si_data import in_si, quantity_of

PAPER = resources.files("armcontour.jobs") / "library" / "paper.yaml"
MORE = """
name: more
arm: {name: ur5e, payload: {mass: 2 kg, center: [1 mm, 0, 5 cm]}, tool: {position: [0, 0, 120 mm]}}
path: {file: a.dxf, chord_tolerance: 20 um, layers: {cut: {speed: 50 mm/s, tolerance: 0.1 mm}}}
limits: {joint_velocity: [90 deg/s, 90 deg/s, 1, 2, 3, 4], joint_jerk: null, tool_jerk: 40 m/s^3}
process: {lead_in: {shape: arc, length: 5 mm}, dwell: 20 ms, begin: [1 mm, 2 mm]}
servo: {kp: [25 1/s, 25, 25, 25, 25, 25], order: first, dead_time: 4 ms}
plant: {dead_time: 5 ms}
certificate: {tolerance: 0.1 mm, box: {gains: 10 %, payload: 1 kg}}
memory: 3 GB
runs: {one: {timing: {reserve: 5 %}, smoothing: [10 ms, 20 ms], corners: sharp}}
"""
TEXTS = {
    "paper": PAPER.read_text(encoding="utf-8"),
    "more": MORE,
    **{x: cell_text(x) for x in cell_names()},
}


def texts_with_units(data):
    """All texts that begin with a number and have a unit."""
    if isinstance(data, dict | list):
        inner = data.values() if isinstance(data, dict) else data
        return [y for x in inner for y in texts_with_units(x)]
    word = data.split(" ")[0] if isinstance(data, str) and " " in data else ""
    return [data] if word.lstrip("-").replace(".", "", 1).isdigit() else []


@pytest.mark.parametrize("name", TEXTS)
def test_readers_make_the_same_of_it(name):
    data = load(TEXTS[name], name)
    found = in_si(data, CellModel)
    assert texts_with_units(data) and texts_with_units(found) == []
    models = [read_keys(Keys(CellModel), x, name) for x in (data, found)]
    assert plain(asdict(models[0])) == plain(asdict(models[1]))
    assert in_si(found, CellModel) == found


def test_what_is_no_such_quantity_stays():
    data = {"limits": {"speed": "5 mm", "unknown": "5 mm"}, "corners": "sharp", "none": [1]}
    assert in_si(data, CellModel) == data


@pytest.mark.parametrize(
    "key, unit",
    [
        ("limits.speed", "m/s"),
        ("limits.joint_velocity", "rad/s"),
        ("runs.any.corners.tolerance", "m"),
        ("runs.any.timing.reserve", "1"),
        ("runs.any.timing.method", None),
        ("plant.dead_time", "s"),
        ("process.lead_in.length", "m"),
        ("process.by_layer.any.dwell", "s"),
        ("arm.payload.mass", "kg"),
        ("path.layers.any.speed", "m/s"),
        ("memory", "byte"),
        ("limits.spede", None),
    ],
)
def test_a_key_has_its_quantity(key, unit):
    found = quantity_of(CellModel, key.split("."))
    assert (found and found.unit) == unit


def test_a_drawing_in_a_cell_is_data_of_a_job(tmp_path):
    from armcontour.io.cell import read_cell
    from armcontour.io.job_file import job_of, read_keys
    from armcontour.io.job_model import JobModel

    drawing = tmp_path / "line.csv"
    drawing.write_text("x [mm],y [mm]\n300,200\n330,200\n")
    data, source, folder = cell_data("pmk3s", drawing)
    job = job_of(read_keys(Keys(JobModel), data, source), folder, None, False)
    want = read_cell("pmk3s", drawing)
    assert (job.name, job.title) == (want.name, want.title) == ("line", job.title)
    assert job.program.length == want.program.length
    assert [x.name for x in job.runs] == [x.name for x in want.runs]
