"""Touched points in the Studio: the task `measure`, and the edit that writes the frame."""

import json

import numpy as np
import pytest
from docs.pages import run_command
from tests.cli.test_measuring import ARM, DOWN, JOB, JOINTS, POINTS, START, TRUE
from tests.studio.session_pages import SessionPage, session_of
from tests.studio.test_arithmetic import NODE, compute

import armcontour as ac
from armcontour.files import parse_job
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.tasks.dispatch import do, work

# Errors of the touches [m].
NOISE = 1e-4 * np.random.default_rng(2).standard_normal(POINTS.shape)


def touched(points=POINTS, noise=NOISE):
    """Rows of a table in mm and degrees, as they are typed."""
    positions = points @ TRUE.rotation.T + TRUE.position + noise[: len(points)]
    rows = []
    for point, position in zip(points, positions, strict=True):
        q = np.degrees(ARM.inverse(ac.Frame(position, DOWN), near=START))
        rows.append([*(f"{x * 1e3:g}" for x in point), *(f"{x:.7f}" for x in q)])
    return rows


def measure(rows, text=JOB, **options):
    request = {"text": text, "run": "cut", "options": {"rows": rows, **options}}
    return do("measure", request, lambda step: None).header


def figures(header):
    return {x["name"]: x["value"] for x in header["rows"]}


def position(header):
    """Position in the edit that writes the frame [m]."""
    (edit,) = header["changes"][0]["edits"]
    return edit["value"]["position"]


def refusal(rows, text=JOB, **options):
    request = {"text": text, "run": "cut", "options": {"rows": rows, **options}}
    frame = MessageFrame.unpack(work(("1", "measure", request), lambda data: None))
    assert frame.kind == "failed"
    return frame.header["sentence"]


def test_the_studio_measures_what_the_command_measures(tmp_path, monkeypatch):
    rows = touched()
    header = measure(rows)
    (tmp_path / "job.yaml").write_text(JOB)
    table = [f"x [mm],y [mm],z [mm],{JOINTS}", *(",".join(x) for x in rows)]
    (tmp_path / "touches.csv").write_text("\n".join(table))
    monkeypatch.chdir(tmp_path)
    words = ["measure", "part", "touches.csv", "--job", "job.yaml", "--json"]
    code, printed, errors = run_command(words)
    assert code == 0, errors
    command = json.loads(printed)
    shown = figures(header)
    assert shown["expected_error"] == pytest.approx(command["expected_error"], rel=1e-9)
    assert shown["residual"] == pytest.approx(max(command["residuals"]), rel=1e-9)
    (edit,) = header["changes"][0]["edits"]
    assert edit["key"] == ["path", "frame"]
    assert edit["value"]["position"] == pytest.approx(command["position"], abs=1e-12)
    (residuals,) = header["tables"]
    assert len(residuals["cells"]) == 1 + len(rows)
    arm = parse_job(JOB).arm
    q = np.radians([[float(x) for x in row[3:]] for row in rows])
    assert np.allclose(header["touched"]["xyz"], arm.tool_position(q), atol=1e-12)
    # The plane of the picture is that of x and y.
    from_first = np.diff(header["touched"]["uv"], axis=0)
    assert np.allclose(from_first, np.diff(arm.tool_position(q)[:, :2], axis=0), atol=1e-9)


def test_values_may_have_units_and_rows_may_be_empty():
    rows = touched()
    other = [
        [f"{float(row[0]) / 1e3} m", *row[1:3], f"{np.radians(float(row[3])):.12f} rad", *row[4:]]
        for row in rows
    ]
    spaced = [[f" {cell} " for cell in row] for row in other]
    empty = [""] * 9
    expected = position(measure(rows))
    for variant in (other, spaced, [empty, *rows, empty]):
        assert position(measure(variant)) == pytest.approx(expected, abs=1e-9)
    loud, usual = (figures(measure(rows, noise=x))["expected_error"] for x in ("1 mm", ""))
    assert loud > 3 * usual
    assert figures(measure(rows, noise="1")) == figures(measure(rows, noise="1 mm"))


def test_doubts_are_refused_and_accepted_as_by_the_command():
    rows = [[x, f"-{y}", *more] for x, y, *more in touched()]
    assert "turned_over" in refusal(rows)
    shown = figures(measure(rows, accept="turned_over"))
    assert shown["doubts"] == "turned_over"
    assert np.degrees(shown["tilt"]) == pytest.approx(180.0, abs=0.2)
    # As planned, but for -20 mm in x and the noise.
    assert shown["moved"].startswith("(-20.0")


def test_three_points_of_the_axes_need_no_coordinates():
    rows = [["", "", "", *x[3:]] for x in touched(POINTS[[0, 1, 3]], 0 * NOISE)]
    header = measure(rows)
    (edit,) = header["changes"][0]["edits"]
    assert edit["value"]["position"] == pytest.approx(TRUE.position, abs=1e-6)
    assert header["tables"][0]["cells"][0][:2] != ["touch", "x"]


def test_a_planar_arm_and_a_rail_have_their_own_columns():
    plane = """
name: plane
arm: pmk3s
path: {points: [[0, 0], [0.06, 0.05]], frame: {position: [0.35, 0.1, 0]}}
servo: {kp: 25, kv: 150}
runs: {cut: {}}
"""
    arm = parse_job(plane).arm
    drawn = np.array([(0.0, 0.0), (0.06, 0.05), (0.0, 0.1)])
    q = np.degrees(arm.inverse(drawn + [0.34, 0.11]))
    rows = [
        [*(f"{x * 1e3:g}" for x in point), *(f"{x:.8f}" for x in row)]
        for point, row in zip(drawn, q, strict=True)
    ]
    (edit,) = measure(rows, plane)["changes"][0]["edits"]
    assert edit["value"]["position"] == pytest.approx([0.34, 0.11, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [], ["no touches"]),
        (lambda rows: rows[:2], ["only 2"]),
        (lambda rows: [rows[0], [*rows[1][:5], "abc", *rows[1][6:]], *rows[2:]],
         ["Touch 2", "q3 (elbow_joint)", "abc"]),
        (lambda rows: [rows[0], [*rows[1][:5], "", *rows[1][6:]], *rows[2:]],
         ["Touch 2", "no value of q3"]),
        (lambda rows: [rows[0], [*rows[1][:5], "5 mm", *rows[1][6:]], *rows[2:]],
         ["Touch 2", "rad", "5 mm"]),
        (lambda rows: [["", *rows[0][1:]], *rows[1:]], ["Touch 1", "no value of x"]),
        (lambda rows: [rows[0][:-1], *rows[1:]], ["Touch 1 has 8 values"]),
        (lambda rows: [rows[1], rows[1], rows[2]], ["on a line"]),
        (lambda rows: [[*rows[2][:3], *rows[0][3:]], *rows[1:]],
         ["Touch 1 does not fit its point"]),
        (lambda rows: {"a": 1}, ["rows of texts"]),
        (lambda rows: [[1.0] * 9], ["rows of texts"]),
        (lambda rows: rows * 200, ["At most 500", "800"]),
    ],
)  # fmt: skip
def test_wrong_touches_are_refused_with_a_sentence(change, words):
    sentence = refusal(change(touched()))
    assert all(x in sentence for x in words), sentence
    assert sentence.endswith(".")


def test_the_frame_is_written_into_the_text_and_undone(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    session = session_of(file)
    page = SessionPage(session)
    session.begin()
    columns = page.last("document")["touch_columns"]
    assert [x["label"] for x in columns] == ["x", "y", "z", *(f"q{k}" for k in range(1, 7))]
    assert [x["unit"] for x in columns] == ["mm"] * 3 + ["deg"] * 6
    page.edit(*measure(touched())["changes"][0]["edits"])
    text = session.editor.document.text
    part = parse_job(text).part
    assert np.allclose(part.position, TRUE.position, atol=5e-4)
    assert "# A part on a table." in text and "rpy" not in text.split("frame")[1].split("}")[0]
    page.say("undo")
    assert session.editor.document.text == JOB
    session.close()


@pytest.mark.skipif(NODE is None, reason="the page's code is run by node")
@pytest.mark.parametrize(
    ("text", "cells"),
    [
        ("1\t2\n3\t4\n", [["1", "2"], ["3", "4"]]),
        ("x [mm]\ty [mm]\r\n-1.5\t2\r\n", [["-1.5", "2"]]),
        ("1, 2 deg;3\n", [["1, 2 deg", "3"]]),
        ("1,2\n\n3,\n", [["1", "2"], ["3", ""]]),
        ("12.5", [["12.5"]]),
        ("1\n2\n", [["1"], ["2"]]),
    ],
)
def test_pasted_tables_are_split_into_cells(text, cells):
    script = """
    globalThis.document = { querySelector: () => null };
    const { cellsOf } = await import("./touches.js");
    tell(cellsOf(given));
    """
    assert compute(script, text) == cells
