"""Tasks of the task process: exact results, exports and reports."""

import numpy as np
import pytest
import yaml
from tests.dynamics_extra import needs_dynamics
from tests.studio.conftest import DRAWINGS
from tests.studio.session_pages import figure

import armcontour as ac
from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.studio.tasks.dispatch import do


def quiet(step):
    """Hears nothing."""


def ask(task, data, run, *, origin="", **options):
    text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    folder = str(DRAWINGS)
    request = {"text": text, "folder": folder, "run": run, "options": options, "allowed": [folder]}
    return do(task, {**request, "origin": origin}, quiet)


@pytest.fixture
def coarse(paper):
    """The paper's job with fewer set-points and runs."""
    del paper["experiment"]
    paper["runs"] = {x: paper["runs"][x] for x in ("uncompensated", "optimal")}
    for x in paper["runs"].values():
        x["cycle"] = "2 ms"
    return paper


@pytest.fixture
def short(coarse):
    return coarse | {"path": {"points": [[0.35, 0.1], [0.37, 0.12], [0.36, 0.13]]}}


@pytest.fixture
def line(square):
    """The square's job with a short line."""
    return square | {"path": square["path"] | {"points": [[0, 0, 0], [0.01, 0, 0]]}}


GASKET = """
name: gasket
arm: {name: ur5e, work: {position: [400 mm, -100 mm, 100 mm]}}
path:
  file: gasket.dxf
  names: [CUT-1, CUT-2]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.2 m/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
cycle: 8 ms
runs: {cut: {}}
"""


@pytest.mark.parametrize("name_of_job", ["coarse", "square", "gasket"])
def test_the_results_of_a_task_equal_a_run_of_the_saved_job(name_of_job, request):
    data = GASKET if name_of_job == "gasket" else request.getfixturevalue(name_of_job)
    text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    job_result = run(parse_job(text, folder=DRAWINGS))
    for name, result in job_result.runs.items():
        figures = ask("figures", text, name).header
        e = result.evaluation
        rows = {"duration": e.duration, "settled": e.settled}
        rows |= {f"contour_error.{x}": getattr(e.contour_error, x) for x in ("rms", "max")}
        rows["off_drawing"] = e.off_drawing
        rows["saturated"] = e.saturated.max()
        if result.clearance is not None:
            rows["clearance.low"] = result.clearance.low
        for key, value in rows.items():
            assert figure(figures, key) == pytest.approx(value, abs=1e-9), key
        assert figures["warnings"] == result.warnings


@needs_dynamics
def test_a_collision_is_refused_with_its_position(square):
    box = {"type": "box", "name": "post", "size": [0.02, 0.02, 0.1], "at": [0.1, 0.1, 0.0]}
    square["scene"] = {"obstacles": [box | {"fixed_to": "part"}]}
    square["seed"] = [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
    frame = ask("figures", square, "optimal")
    assert (frame.kind, frame.header["tier"]) == ("refusal", 3)
    assert frame.header["error"] == "Collision" and frame.header["exit"] == 8
    assert "post" in frame.header["sentence"]
    assert abs(frame.header["at"]["uv"] - np.array([0.1, 0.1])).max() < 0.02
    assert frame.header["at"]["t"] >= 0
    contacts = frame.header["contacts"]
    first = contacts[0]
    assert first["t"] == frame.header["at"]["t"]
    assert {first["first"], first["second"]} == set(frame.header["bodies"])
    assert [x["t"] for x in contacts] == sorted(x["t"] for x in contacts)
    # At the stated joint positions, the tool is where the square begins.
    arm = parse_job(yaml.safe_dump({**square, "scene": {}}, sort_keys=False)).arm
    tool = arm.tool_position(np.array([first["q"]]))[0]
    assert contacts[0]["t"] == 0 and np.abs(tool).max() < 1e-9
    # The nearest points are in the frame of the floor, in which the part is at (0.4, -0.05, 0.2).
    away = np.array(first["points"]) - [0.5, 0.05, 0.2]
    assert np.linalg.norm(away, axis=1).max() < 0.1
    # Data that make no job are refused as well.
    del square["servo"]
    frame = ask("figures", square, "optimal")
    assert frame.kind == "refusal" and "servo" in frame.header["sentence"]


@needs_dynamics
def test_the_distance_to_an_obstacle_is_a_figure_of_its_own(square):
    post = {"type": "box", "name": "post", "size": [0.02, 0.02, 0.1], "at": [0.7, 0.3, 0.3]}
    square["scene"] = {"obstacles": [post]}
    header = ask("figures", square, "optimal").header
    rows = {x["name"]: x for x in header["rows"]}
    assert "post" in rows["obstacle"]["note"]
    # Two links of the arm are nearer. They are a figure of their own, with their place.
    own = rows["own_links"]
    assert rows["obstacle"]["value"] > own["value"] > 0
    assert own["value"] == pytest.approx(rows["clearance.low"]["value"], rel=1e-9)
    assert "post" not in own["note"]
    # The least allowed distances are stated; an obstacle can have its own.
    margins = header["margins"]
    assert margins["obstacle"] == "5 mm" and margins["own_links"] == "2 mm"
    square["scene"] = {"obstacles": [{**post, "margin": "8 mm"}], "margins": {"own": 0, "tool": 0}}
    margins = ask("figures", square, "optimal").header["margins"]
    assert margins["obstacle"] == "8 mm" and margins["own_links"] == ""
    assert header["own_links_t"] == header["nearest"]["t"] != header["obstacle_t"]
    # Without obstacles, there is one figure.
    del square["scene"]
    names = {x["name"] for x in ask("figures", square, "optimal").header["rows"]}
    assert "clearance.low" in names and not {"obstacle", "own_links"} & names


def test_an_export_offers_the_outputs_that_it_misses(line):
    line["process"] = {"switch": {"name": "torch"}}
    (change,) = ask("export", line, "optimal", format="urscript").header["changes"]
    assert change["edits"] == [{"do": "set", "key": ["export", "outputs", "torch"], "value": 0}]
    line["export"] = {"outputs": {"torch": 0}}
    assert ask("export", line, "optimal", format="urscript").header["changes"] == []


FORMATS = (
    ({"format": "csv"}, ".csv", b"t [s],q"),
    ({"format": "csv", "of": "planned", "cycle": 0.01}, ".csv", b"t [s],q"),
    ({"format": "ros-yaml"}, ".yaml", b""),
    ({"format": "urscript"}, ".script", b""),
    ({"format": "kuka"}, ".src", b""),
    ({"format": "abb"}, ".mod", b"MODULE"),
)


@pytest.mark.parametrize(("format", "comment"), [("urscript", "#"), ("kuka", ";"), ("abb", "!")])
def test_a_program_states_when_and_of_what_it_was_made(format, comment, line):
    origin = "2026-05-04 10:12, job line, run optimal, SHA-256 of the job 0123abcd"
    answers = (ask("export", line, "optimal", format=format, origin=x) for x in ("", origin))
    plain, told = (x.arrays["content"].tobytes().decode().splitlines() for x in answers)
    (said,) = [x.strip() for x in told if x not in plain]
    assert said == f"{comment} {origin}"
    # Nothing else differs.
    assert [x for x in told if origin not in x] == plain


def test_the_studio_exports_files_of_all_formats(line):
    for options, ending, begins in FORMATS:
        answer = ask("export", line, "optimal", **options)
        content = answer.arrays["content"].tobytes()
        # KRL finds a program by the name of its file, which may have no hyphen.
        stem = "square_optimal" if ending == ".src" else "square-optimal"
        assert answer.header["name"] == f"{stem}{ending}"
        assert answer.header["bytes"] == len(content) > 100
        assert begins in content[:100], options


def test_invalid_options_of_tasks_are_refused(line, short):
    hostile = {"format": "/etc/passwd.j2"}
    for task, job, options, words in (
        ("export", line, hostile, "but is '/etc/passwd.j2'"),
        (
            "certify",
            short,
            {"tolerance": 5.5e-3, "of": 1},
            "CertificateGoal: there is no argument 'of'",
        ),
        ("certify", short, {}, "next to Certify"),
    ):
        with pytest.raises(ac.InvalidInput, match=words):
            ask(task, job, "optimal", **options)


def test_reports_of_runs_and_certificates_are_pages(short):
    answer = ask("report", short, "optimal")
    assert answer.header["name"].endswith(".html")
    assert b"optimal" in answer.arrays["content"].tobytes()
    answer = ask("certify", short, "optimal", tolerance=5.5e-3)
    certificate = answer.header["certificate"]
    assert certificate["duration"] in [x["value"] for x in answer.header["rows"]]
    assert certificate["budget"]["left"] >= 0
    assert answer.header["name"] == "paper-certificate.html"
    # The answer states for which robots the certificate is valid.
    text = "Valid for independent joint servos only: "
    assert any(x.startswith(text) for x in answer.header["notes"])
