"""Waits for inputs in exported files: named inputs, refusals, and the stored result."""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from docs.pages import run_command
from tests.controllers.simulated import Simulated
from tests.files.tables import refusals

import armcontour as ac
from armcontour.controllers import play
from armcontour.files import parse_job
from armcontour.files.exports import (
    CsvFormat,
    RosYamlFormat,
    SetPointTable,
    TemplateFormat,
    URScriptFormat,
)
from armcontour.files.exports.export_checks import check_exports
from armcontour.motion import TimedWait
from armcontour.program import Pierce, Switch, Wait
from armcontour.studio.tasks.dispatch import do

JOB = yaml.safe_load("""
name: seam
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  points: [[0.40, 0.0, 0.2], [0.45, 0.0, 0.2], [0.45, 0.05, 0.2]]
  orientation: {axis: [0, 0, -1]}
process:
  switch: {name: torch}
  wait: [{input: clamp, within: 2 s}, {input: arc, within: 500 ms, at: switched_on}]
limits: {speed: 100 mm/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 30 ms}
cycle: 2 ms
runs: {a: {}}
""")
INPUTS = {
    "clamp": {"urscript": 2, "kuka": 5, "abb": "diClamp"},
    "arc": {"urscript": 3, "kuka": 6, "abb": "diArc"},
}
# A program of each format reads these inputs.
READS = {
    "urscript": ["get_standard_digital_in(2)", "get_standard_digital_in(3)"],
    "kuka": ["$IN[5]", "$IN[6]"],
    "abb": ["WaitDI diClamp, 1", "WaitDI diArc, 1"],
}
ENDING = {"urscript": "script", "kuka": "src", "abb": "mod"}
CYCLE = 4e-3


def read(export, changes=None):
    return parse_job(yaml.safe_dump({**JOB, **(changes or {}), "export": export}))


def resting(input="clamp", *, rest=0.1, t=0.04, moves=0.0, count=60):
    """A table of a robot that waits after some points; `moves`: its step per cycle [rad]."""
    q = np.full((count, 6), 0.5) + moves * np.arange(count)[:, None]
    wait = TimedWait(input=input, within=1.0, at="start", t=t, rest=rest)
    names = tuple(f"axis_{k}" for k in range(1, 7))
    return SetPointTable(name="part", joint_names=names, cycle=CYCLE, t=np.arange(count) * CYCLE,
                         q=q, waits=(wait,))  # fmt: skip


@pytest.mark.parametrize("kind", list(READS))
def test_programs_wait_for_the_named_inputs_of_a_job_file_and_in_python(tmp_path, kind):
    file = tmp_path / "job.yaml"
    export = {"formats": [kind], "inputs": INPUTS, "cycle": JOB["cycle"]}
    file.write_text(yaml.safe_dump({**JOB, "export": export}))
    code, printed, _ = run_command(["run", str(file), "--out", str(tmp_path / "out")])
    assert code == 0
    assert "clamp, arc" in " ".join(printed.split())
    written = tmp_path / f"out/a/export/reference.{ENDING[kind]}"
    positions = [written.read_text().index(x) for x in READS[kind]]
    assert positions == sorted(positions)
    # The same process in Python.
    waits = (Wait("clamp", within=2.0), Wait("arc", within=0.5, at="switched_on"))
    process = ac.Process(switch=Switch("torch"), wait=waits)
    job = dataclasses.replace(read({}, {"process": {}}), process=process)
    (result,) = ac.run(job, simulate=False).runs.values()
    inputs = {name: x[kind] for name, x in INPUTS.items()}
    format = URScriptFormat(inputs=inputs)
    if kind != "urscript":
        format = TemplateFormat(template=kind, inputs=inputs)
    made = tmp_path / f"reference.{ENDING[kind]}"
    with pytest.warns(UserWarning, match="torch"):
        ac.export(result.trajectory, made, format, arm=job.arm, cycle=result.run.cycle)
    # The titles of the programs differ.
    lines = [x.read_text().splitlines()[12:] for x in (made, written)]
    assert lines[0] == lines[1]


def test_stored_result_is_exported_with_its_waits(tmp_path):
    file = tmp_path / "job.yaml"
    export = {"formats": ["urscript"], "inputs": INPUTS, "outputs": {"torch": 0}}
    file.write_text(yaml.safe_dump({**JOB, "export": export}))
    out = tmp_path / "out"
    assert run_command(["run", str(file), "--out", str(out)])[0] == 0
    data = json.loads((out / "summary.json").read_text())["runs"]["a"]
    assert [x["input"] for x in data["waits"]] == ["clamp", "arc"]
    code, _, _ = run_command(["export", str(out), str(tmp_path / "again.script")])
    assert code == 0
    again = (tmp_path / "again.script").read_text()
    assert again == (out / "a/export/set_points.script").read_text()
    code, _, failed = run_command(["export", str(out), str(tmp_path / "again.csv")])
    assert code == 2 and "urscript, kuka, abb" in " ".join(failed.split())


WRONG = [
    (["csv"], INPUTS, {}, "csv cannot wait ... clamp ... urscript, kuka, abb"),
    (["ros-yaml"], INPUTS, {}, "ros-yaml cannot wait ... urscript, kuka, abb"),
    (["urscript"], {"clamp": 2}, {}, "waits for arc ... no input ... {arc:"),
    (["kuka"], {"clamp": {"abb": "diClamp"}, "arc": 6}, {}, "waits for clamp ... no input"),
    (["urscript"], {**INPUTS, "door": 4}, {}, "export.inputs names 'door' ... arc, clamp"),
    (["urscript"], {"clamp": 8, "arc": 3}, {}, "clamp must be from 0 to 7"),
    (["urscript"], {"clamp": "diClamp", "arc": 3}, {}, "clamp must be a number"),
    (["kuka"], {"clamp": 0, "arc": 3}, {}, "integers of at least 1"),
    (["abb"], {"clamp": 5, "arc": "diArc"}, {}, "names of signals"),
    (["abb"], {"clamp": "di-1", "arc": "diArc"}, {}, "RAPID does not allow"),
    (["kuka"], INPUTS, {"cycle": "60 ms"}, "0.1 s ... 60 ms ... 0.12 s ... rest"),
    (["urscript"], INPUTS, {"process": {}}, "waits for no input"),
]


def test_exports_that_cannot_wait_are_refused_before_the_plan():
    rows = [((formats, inputs, keys), words) for formats, inputs, keys, words in WRONG]

    def check(row):
        formats, inputs, keys = row
        check_exports(read({"formats": formats, "inputs": inputs}, keys))

    refusals(check, rows)
    check_exports(read({"formats": ["urscript", "kuka", "abb"], "inputs": INPUTS}))


def test_inputs_are_of_formats_that_wait():
    with pytest.raises(ac.InvalidInput, match="inputs.clamp.csv has no effect"):
        read({"formats": ["csv"], "inputs": {"clamp": {"csv": 1}}})


def test_a_process_that_is_off_waits_for_nothing(tmp_path):
    off = {"process": {**JOB["process"], "off": True}}
    job = read({"formats": ["csv", "urscript"], "inputs": INPUTS}, off)
    check_exports(job)
    assert not job.export.inputs
    (result,) = ac.run(job, simulate=False).runs.values()
    assert result.trajectory.waits == ()


def test_motions_that_are_played_do_not_wait():
    arm = Simulated(late=False, cycle=CYCLE, acceleration=100.0)
    with pytest.raises(ac.InvalidInput, match="clamp.*--process-off.*urscript"):
        play(read({}), arm)
    assert play(read({}, {"process": {**JOB["process"], "off": True}}), arm).record is None


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (resting(rest=0.006), "6 ms.*8 ms"),
        (resting(moves=1e-4), "do not rest.*0.0001 rad"),
        (resting('clamp "1"'), "quotes"),
        (resting("Spannmittel geschlossen und Druck ausreichend, Vorrichtung 1 und 2"), "80"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", list(READS))
def test_waits_that_a_program_cannot_express_are_refused(table, words, kind, tmp_path):
    (name,) = (x.input for x in table.waits)
    signal = {"urscript": 1, "kuka": 1, "abb": "diClamp"}[kind]
    format = URScriptFormat(inputs={name: signal})
    if kind != "urscript":
        format = TemplateFormat(template=kind, inputs={name: signal})
    with pytest.raises(ac.InvalidInput, match=words):
        format.write(table, tmp_path / "made.src")


def test_tables_and_templates_without_waits_are_refused(tmp_path):
    for format in (CsvFormat(), RosYamlFormat(), TemplateFormat(template="kuka")):
        with pytest.raises(ac.InvalidInput, match="clamp"):
            format.check(resting())
    template = tmp_path / "house.j2"
    template.write_text("{% for p in points %}{{ p.t }}\n{% endfor %}")
    house = TemplateFormat(template=template, inputs={"clamp": 4})
    with pytest.raises(ac.InvalidInput, match="house.j2.*clamp"):
        house.write(resting(), tmp_path / "made.txt")
    template.write_text(
        "{% for p in points if p.wait %}{{ p.number }} {{ inputs[p.wait.input] }} "
        "{{ p.wait.within }} {{ wait_message(p.wait) }}{% endfor %}"
    )
    house.write(resting(), tmp_path / "made.txt")
    written = (tmp_path / "made.txt").read_text()
    assert written == "11 4 1.0 clamp did not come within 1 s"


def test_rest_must_be_longer_than_the_lead_of_the_set_points():
    slow = {"servo": {"kp": "25 1/s", "kv": "150 1/s", "dead_time": "150 ms"}}
    job = read({}, slow)
    (result,) = ac.run(job).runs.values()
    table = ac.files.exports.make_table(result.set_points, name="part")
    with pytest.raises(ac.InvalidInput, match="Increase rest"):
        assert table.point_of_waits
    # The plan itself has no lead.
    plan = ac.files.exports.make_table(result.trajectory, name="part")
    assert len(plan.point_of_waits) == 2


def test_analog_output_has_its_value_at_rest_while_the_robot_waits_for_the_process():
    process = ac.Process(
        switch=Switch("torch"),
        pierce=Pierce(0.05),
        wait=Wait("arc", within=0.5, at="switched_on"),
        analog=(ac.program.Analog(name="power", rest=0.25, off=0.125),),
    )
    job = dataclasses.replace(read({}), process=process)
    (result,) = ac.run(job, simulate=False).runs.values()
    outputs = ac.jobs.analog_outputs(result.path, result.trajectory, process, result.run.limits)
    (wait,) = result.trajectory.waits
    start = result.trajectory.contour_spans[0].t[0]
    t = np.array([wait.t + 1e-6, wait.t + 0.05, start - 1e-6])
    np.testing.assert_allclose(outputs["power"](t), 0.25)


def test_the_studio_refuses_a_wait_without_an_input(tmp_path):
    text = yaml.safe_dump({**JOB, "export": {"inputs": {"clamp": 1}}})
    request = {"text": text, "folder": str(tmp_path), "run": "a", "options": {"format": "urscript"}}
    with pytest.raises(ac.InvalidInput, match="waits for arc"):
        do("export", request, lambda *_: None)
