"""Exports that cannot be written are refused before the plan; outputs can differ by format."""

import dataclasses

import pytest
import yaml
from tests.files.tables import refusals

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.exports.export_checks import check_export, check_exports
from armcontour.files.exports.formats import format_named, outputs_of
from armcontour.jobs import Exports
from armcontour.studio.tasks.dispatch import do

JOB = yaml.safe_load("""
name: square
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  points: [[0.40, 0.0, 0.2], [0.45, 0.0, 0.2], [0.45, 0.05, 0.2]]
  orientation: {axis: [0, 0, -1]}
process: {switch: {name: laser}}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {a: {}}
""")
PER_FORMAT = {"laser": {"kuka": 17, "abb": "doLaser", "urscript": 3}}
POWER = {"switch": {"name": "laser"}, "analog": [{"name": "power", "full": 1000}]}
FR3 = {"arm": "fr3", "runs": {"a": {}}}
RAIL = {"axis": [0, 1, 0], "upper": 1, "velocity": 1, "acceleration": 2}
ON_RAIL = {"arm": {"name": "ur5e", "rail": RAIL}}


def read(export, changes=None):
    return parse_job(yaml.safe_dump({**JOB, **(changes or {}), "export": export}))


# Exports, other keys of the job, and words of the message.
WRONG = [
    (["kuka", "abb"], {"laser": 17}, {}, "abb ... names of signals ... laser is 17 ... differ"),
    (
        ["abb", "kuka"],
        {"laser": "doLaser"},
        {},
        "kuka ... integers ... is doLaser ... differ",
    ),
    (["urscript"], {"laser": "do"}, {}, "urscript ... laser must be a number ... differ"),
    (["urscript"], {"laser": 8}, {}, "laser must be from 0 to 7"),
    (["abb"], {"laser": "7th"}, {}, "RAPID does not allow"),
    (["kuka"], {"lasr": 17}, {}, "export.outputs names 'lasr'"),
    (["kuka"], {"power": 2}, {"process": POWER}, "power has the value 1000 ... from -1 to 1"),
    (["urscript"], {"power": 0}, {"process": POWER}, "power has values from 0 to 1000"),
    (["urscript"], {"power": "AO2"}, {"process": POWER}, "power must be AO0 or AO1 ... differ"),
    (["kuka"], {"laser": 1}, {"process": {"switch": {"name": "laser", "value": 5}}}, "laser has"),
    (["urscript"], {}, {"cycle": "3 ms"}, "a multiple of 2 ms"),
    (["urscript"], {}, FR3, "6 joints"),
    (["kuka"], {}, FR3, "6 revolute joints"),
    (["abb"], {}, FR3, "6 revolute axes"),
    (["urscript"], {}, ON_RAIL, "external axes"),
    (["house.j2"], {}, {}, "There is no template"),
]


def test_exports_that_cannot_be_written_are_refused_before_the_plan():
    rows = [((formats, outputs, keys), words) for formats, outputs, keys, words in WRONG]

    def check(row):
        formats, outputs, keys = row
        check_exports(read({"formats": formats, "outputs": outputs}, keys))

    refusals(check, rows)


def test_exports_that_can_be_written_are_accepted():
    analog = [{"name": "power", "rest": 0.2, "full": 1.0}]
    process = {"switch": {"name": "laser"}, "analog": analog}
    power = {"kuka": 2, "abb": "aoPower", "urscript": "AO1"}
    every = ["csv", "ros-yaml", "urscript", "kuka", "abb"]
    outputs = {**PER_FORMAT, "power": power}
    check_exports(read({"formats": every, "outputs": outputs}, {"process": process}))
    check_exports(read({"formats": every}))
    check_exports(read({"formats": ["kuka", "abb", "csv"], "cycle": "48 ms"}, ON_RAIL))
    # A value that is not on or off needs no output.
    check_exports(read({"formats": every}, {"process": {"switch": {"name": "laser", "value": 5}}}))


def test_only_the_syntax_of_a_template_is_checked_because_it_may_refuse_a_trial(tmp_path):
    job = read({})
    template = tmp_path / "house.j2"
    states = "{% set keeps_times = false %}"
    template.write_text(states + "{% if points|length < 100 %}{{ refuse('too short') }}{% endif %}")
    check_export(job, str(template))
    template.write_text("one\n{% if points %}")
    refusals(lambda x: check_export(job, x), [(str(template), "house.j2, line 2")])
    template.write_text("one")
    refusals(lambda x: check_export(job, x), [(str(template), "keeps_times = true")])


def test_outputs_of_a_job_can_differ_by_format():
    options = read({"formats": ["kuka", "abb"], "outputs": {**PER_FORMAT}}).export
    for kind, output in PER_FORMAT["laser"].items():
        assert outputs_of(format_named(kind, options)) == {"laser": output}
    # A format without an output writes a comment, and one output is for all formats.
    options = dataclasses.replace(options, outputs={"laser": {"abb": "doLaser"}, "gas": 4})
    assert outputs_of(format_named("kuka", options)) == {"gas": 4}
    options = Exports(outputs={"laser": {"house.src.j2": 3}})
    assert options.outputs_for("/some/folder/house.src.j2") == {"laser": 3}
    wrong = [
        ({"laser": {"kukka": 1}}, "outputs.laser ... no format 'kukka'"),
        ({"laser": {"csv": 1}}, "outputs.laser.csv has no effect"),
        ({"laser": {"cell/house.j2": 1}}, "outputs.laser.cell/house.j2 ... without a folder"),
        ({"laser": {"kuka": True}}, "outputs.laser.kuka must be a number or a text"),
        ({"laser": {"kuka": 1.5}}, "outputs.laser"),
    ]
    refusals(lambda x: Exports(outputs=x), wrong)
    refusals(lambda x: read({"outputs": x}), wrong[:3])


def test_a_batch_refuses_exports_that_cannot_be_written(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(yaml.safe_dump({**JOB, "export": {"formats": ["kuka", "abb"]}}))
    outputs = [{"laser": 17}, {"laser": "doLaser"}]
    with pytest.raises(ac.InvalidInput, match="names of signals"):
        ac.batch(file, {"export.outputs": outputs}, workers=0)
    result = ac.batch(file, {"export.outputs": [*outputs, PER_FORMAT]}, workers=0)
    assert [x.status for x in result.rows] == ["invalid", "invalid", "done"]


def test_the_studio_refuses_an_export_before_it_plans(tmp_path, monkeypatch):
    text = yaml.safe_dump({**JOB, "export": {"outputs": {"laser": 17}}})
    request = {"text": text, "folder": str(tmp_path), "run": "a", "options": {"format": "abb"}}
    steps = []
    with pytest.raises(ac.InvalidInput, match="names of signals"):
        do("export", {**request, "allowed": [str(tmp_path)]}, steps.append)
    assert steps == []
    # An output for this format only is proposed next to that for another one.
    text = yaml.safe_dump({**JOB, "export": {"outputs": {"laser": {"kuka": 17}}}})
    request = {**request, "text": text, "allowed": [str(tmp_path)]}
    (change,) = do("export", request, steps.append).header["changes"]
    (edit,) = change["edits"]
    assert edit["key"] == ["export", "outputs", "laser", "abb"]
