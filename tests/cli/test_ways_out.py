"""Every way out of the package writes the same file of a motion, with the same warnings."""

import dataclasses
import io
import re
import shlex
import warnings

import numpy as np
import pandas as pd
import pytest
from tests.dynamics_extra import needs_dynamics
from tests.studio.test_tasks import ask

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.exports.formats import ENDINGS, ExportFormat, format_named
from armcontour.jobs import analog_outputs

# A corner of a UR5e with a laser whose power follows the speed; one output is not named.
JOB = """
name: corner
arm: ur5e
path:
  points: [[0.45, -0.05, 0.3], [0.50, -0.05, 0.3], [0.50, 0.0, 0.3]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 250 mm/s}
corners: {tolerance: 1 mm}
accuracy: 50 mm
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
process:
  lead_in: {length: 5 mm}
  switch: {name: laser}
  analog: [{name: power, rest: 20 %, full: 100 %}]
export: {formats: [FORMAT], OPTIONS}
runs:
  sent: {timing: {reserve: 10 %}, compensation: {method: METHOD}}
"""
# Words before a sentence: those of a command, of Python and of the Studio.
PREFIX = re.compile(r"^(Warning: )?(export [\w-]+, run \w+: |Format [\w-]+: )?")
# Options of exports with which each format writes a program of the corner.
OPTIONS = {
    "kuka": "outputs: {power: 3}",
    "abb": "outputs: {laser: doLaser}",
    "urscript": "outputs: {power: 0}",
    "ros-yaml": "tolerances: 2",
}
PLANNED = "reference"
SET_POINTS = "set_points"


def job_text(kind, method):
    text = JOB.replace("FORMAT", kind).replace("METHOD", method)
    return text.replace("OPTIONS", OPTIONS.get(kind, "derivatives: 2"))


def sentences(texts):
    """Sentences without what comes before them, however they are capitalised."""
    return {PREFIX.sub("", x).strip().lower() for x in texts}


@pytest.fixture(scope="module")
def result_of(tmp_path_factory):
    """Run a job in Python, once; return the job and its result."""
    known = {}

    def find(kind, method):
        if (kind, method) not in known:
            job = parse_job(job_text(kind, method))
            known[kind, method] = job, ac.run(job).runs["sent"]
        return known[kind, method]

    return find


@pytest.fixture
def command(done, tmp_path, monkeypatch):
    """Run the job by the command, and return its folder and what was printed."""
    monkeypatch.chdir(tmp_path)

    def run_command(kind, method):
        (tmp_path / "job.yaml").write_text(job_text(kind, method))
        printed = done(*shlex.split("run job.yaml --out out --no-changes"))
        return tmp_path / "out", printed.splitlines()

    return run_command


def by_python(result_of, kind, method, motion, file):
    """Export by `ac.export`; return the sentences of its warnings."""
    job, result = result_of(kind, method)
    data = result.trajectory if motion == PLANNED else result.set_points
    form = format_named(kind, job.export)
    name = f"corner sent {motion}"
    analog = analog_outputs(result.path, result.trajectory, job.process, result.run.limits)
    options = {"analog": analog} if form.writes_analog else {}
    form = form.of_run(job.export, result, data, job.arm)
    form = dataclasses.replace(form, name=name, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        ac.export(data, file, form, arm=job.arm)
    return sentences(str(x.message) for x in caught)


def by_studio(kind, method, motion):
    """Export in the Studio; return the content and the sentences of its warnings."""
    of = {PLANNED: "planned", SET_POINTS: "set_points"}[motion]
    answer = ask("export", job_text(kind, method), "sent", format=kind, of=of)
    return answer.arrays["content"].tobytes(), sentences(answer.header["warnings"])


def same_program(content):
    """The content of a program without its name, which is that of its file."""
    return re.sub(rb"corner_sent|made|reference", b"NAME", content)


def warnings_of(lines, kind):
    """The sentences of a command's warnings about its exports."""
    return sentences(x for x in lines if f"export {kind}, run" in x)


@needs_dynamics
@pytest.mark.parametrize("kind", ENDINGS)
@pytest.mark.parametrize("method", ["none", "inverse"])
def test_every_way_out_writes_the_same_file(kind, method, command, done, result_of, tmp_path):
    """By the commands `run` and `export`, in Python and in the Studio, for every format."""
    folder, printed = command(kind, method)
    form = format_named(kind)
    motions = [PLANNED, SET_POINTS] if form.keeps_times else [PLANNED]
    ending = ENDINGS[kind]
    written = {x.stem: x for x in (folder / "sent" / "export").iterdir()}
    if form.has_all_motions:
        # The bag has its set-points, plan and simulation in one file.
        assert set(written) == {"motions"}
        return
    assert set(written) == set(motions)
    of_run = warnings_of(printed, kind)
    in_python = set()
    in_studio = set()
    for motion in motions:
        content = same_program(written[motion].read_bytes())
        file = tmp_path / f"made{ending}"
        in_python |= by_python(result_of, kind, method, motion, file)
        assert same_program(file.read_bytes()) == content
        shown, said = by_studio(kind, method, motion)
        assert same_program(shown) == content
        in_studio |= said
    # In Python, only formats that write analog outputs have an argument for them.
    assert of_run - in_python <= {"the format does not support analog outputs (power)."}
    assert in_python <= of_run
    # The Studio repeats the warnings of the run itself.
    assert in_studio - sentences(result_of(kind, method)[1].warnings) == of_run
    # A stored result has no power and no tolerances, so that only its points are compared.
    done("export", "out", f"again{ending}")
    again = points_of(kind, (tmp_path / f"again{ending}").read_bytes())
    np.testing.assert_array_equal(again, points_of(kind, written[motions[-1]].read_bytes()))


def points_of(kind, content):
    """The joint positions in a file, in its own unit, (n, 6)."""
    text = content.decode()
    if kind == "csv":
        return pd.read_csv(io.StringIO(text)).filter(regex="^q ").to_numpy()
    if kind == "kuka":
        rows = re.findall(r"A1 (.*?), A2 (.*?), A3 (.*?), A4 (.*?), A5 (.*?), A6 (.*?)[,}]", text)
    else:
        before = {"abb": "MoveAbsJ [[", "urscript": "servoj([", "ros-yaml": "positions: ["}[kind]
        rows = [x.split(",") for x in re.findall(re.escape(before) + r"(.*?)\]", text)]
    return np.array(rows, dtype=float)


@needs_dynamics
@pytest.mark.parametrize("kind", [x for x in ENDINGS if not format_named(x).keeps_times])
@pytest.mark.parametrize("of", ["compensated", "learned", "certified"])
def test_a_controller_that_plans_itself_gets_no_changed_set_points(kind, of, result_of, tmp_path):
    # Only a job that sends set-points compensates them.
    _, result = result_of("csv", "inverse")
    file = tmp_path / f"made{ENDINGS[kind]}"
    with pytest.raises(ac.InvalidInput, match="plan"):
        ac.export(result.set_points, file)
    assert not file.exists()
    source = {"compensated": "set_points"}.get(of, of)
    with pytest.raises(ac.InvalidInput, match="plan"):
        ask("export", job_text(kind, "inverse"), "sent", format=kind, of=source)


def test_a_format_states_whether_its_controller_keeps_the_times():
    with pytest.raises(TypeError, match="keeps_times"):
        type("Forgotten", (ExportFormat,), {"kind": "forgotten"})
