"""The command `measure`: the job with the measured part, work frame or tool."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armcontour as ac

JOB = """\
# A part on a table.
name: part
arm: ur5e
path:
  points: [[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0]]
  orientation: {axis: [0, 0, -1]}
  frame: {position: [0.42, -0.1, 0.1], rpy: [0, 0, 10 deg]}   # as planned
limits: {speed: 50 mm/s}
corners: {tolerance: 1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {cut: {}}
"""
ARM = ac.load_arm("ur5e")
DOWN = Rotation.from_euler("x", np.pi).as_matrix()
START = ARM.inverse(ac.Frame((0.4, 0.0, 0.1), DOWN))
POINTS = np.array([(0, 0, 0), (0.2, 0, 0), (0.2, 0.1, 0), (0, 0.1, 0)])
TRUE = ac.Frame.rpy((0.4, -0.1, 0.1), (0.0, 0.0, 0.3))
JOINTS = ",".join(f"q{k} [deg]" for k in range(1, 7))


def touches(points):
    """Return the rows of a table of touches at points of the drawing."""
    positions = points @ TRUE.rotation.T + TRUE.position
    q = [np.degrees(ARM.inverse(ac.Frame(x, DOWN), near=START)) for x in positions]
    return [",".join(f"{x:.7f}" for x in row) for row in q]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "job.yaml").write_text(JOB)
    rows = [
        f"{x * 1e3:g},{y * 1e3:g},{z * 1e3:g},{row}"
        for (x, y, z), row in zip(POINTS, touches(POINTS), strict=True)
    ]
    table = "\n".join([f"x [mm],y [mm],z [mm],{JOINTS}", *rows])
    (tmp_path / "touches.csv").write_text(table)
    (tmp_path / "axes.csv").write_text("\n".join([JOINTS, *touches(POINTS[[0, 1, 3]])]))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_measured_part_replaces_the_part_frame_and_keeps_comments(folder, done):
    done("measure", "part", "touches.csv", "--job", "job.yaml", "--out", "new.yaml")
    text = (folder / "new.yaml").read_text()
    assert "# A part on a table." in text
    part = ac.read_job(folder / "new.yaml").part
    np.testing.assert_allclose(part.position, TRUE.position, atol=1e-7)
    np.testing.assert_allclose(part.rotation, TRUE.rotation, atol=1e-6)


def test_touches_without_points_are_the_axes_of_the_part(folder, done):
    done("measure", "part", "axes.csv", "--job", "job.yaml", "--out", "new.yaml")
    part = ac.read_job(folder / "new.yaml").part
    np.testing.assert_allclose(part.position, TRUE.position, atol=1e-7)
    np.testing.assert_allclose(part.rotation, TRUE.rotation, atol=1e-6)


def test_measured_work_frame_moves_the_part_and_keeps_its_frame(folder, done):
    done("measure", "work", "touches.csv", "--job", "job.yaml", "--out", "new.yaml")
    before = ac.read_job(folder / "job.yaml")
    after = ac.read_job(folder / "new.yaml")
    np.testing.assert_array_equal(after.part.position, before.part.position)
    # The drawing's points are touched at the same joint positions as in the table.
    (contour,) = after.program.contours
    q = np.radians([[float(x) for x in row.split(",")] for row in touches(POINTS[:3])])
    np.testing.assert_allclose(after.arm.tool_position(q), contour.path.vertices, atol=1e-7)


@pytest.mark.parametrize(
    ("arm", "rotation"),
    [
        ("ur5e", np.eye(3)),
        (
            "{name: ur5e, tool: {position: [0, 0, 0.1], rpy: [0, 90 deg, 0]}}",
            Rotation.from_euler("y", np.pi / 2).as_matrix(),
        ),
    ],
    ids=["no tool", "turned tool"],
)
def test_measured_tool_keeps_its_rotation(folder, done, arm, rotation):
    (folder / "job.yaml").write_text(JOB.replace("arm: ur5e", f"arm: {arm}"))
    tool = np.array([0.01, 0.02, 0.15])
    turns = Rotation.from_euler("xyz", [[3, 0, 0], [3, 0.6, 0], [3, 0, 2], [2.5, 0, 1]])
    touching = [ARM.with_tool(tool).inverse(ac.Frame((0.4, 0, 0.2), x)) for x in turns]
    rows = [",".join(f"{x:.7f}" for x in np.degrees(q)) for q in touching]
    (folder / "poses.csv").write_text("\n".join([JOINTS, *rows]))
    done("measure", "tool", "poses.csv", "--job", "job.yaml", "--out", "new.yaml")
    measured = ac.read_job(folder / "new.yaml").arm.chain.tool
    np.testing.assert_allclose(measured.position, tool, atol=1e-7)
    np.testing.assert_allclose(measured.rotation, rotation, atol=1e-12)


def test_relative_files_of_the_job_are_found_from_its_new_folder(folder, done):
    (folder / "drawing.csv").write_text("x [mm],y [mm]\n0,0\n200,0\n200,100\n")
    job = JOB.replace("points: [[0, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0]]", "file: drawing.csv")
    (folder / "job.yaml").write_text(job)
    (folder / "other").mkdir()
    done("measure", "part", "touches.csv", "--job", "job.yaml", "--out", "other/new.yaml")
    assert ac.read_job(folder / "other" / "new.yaml").program.contours


def test_frame_is_printed_as_json_and_nothing_is_written(folder, done):
    before = sorted(folder.iterdir())
    page = json.loads(done("measure", "part", "touches.csv", "--job", "job.yaml", "--json"))
    assert page["position"] == pytest.approx(TRUE.position, abs=1e-7)
    assert len(page["residuals"]) == 4
    assert sorted(folder.iterdir()) == before


def y_down(folder):
    """Write touches whose coordinates have y downwards, as some drawings show them."""
    lines = (folder / "touches.csv").read_text().replace(",100,0,", ",-100,0,")
    (folder / "y_down.csv").write_text(lines)


@pytest.mark.parametrize("target", ["part", "work"])
def test_a_part_upside_down_is_refused_unless_the_doubt_is_accepted(folder, done, refused, target):
    y_down(folder)
    words = f"{target} y_down.csv --job job.yaml"
    rows = [(f"measure {words} --out new.yaml", ["y_down.csv", "upside down", "turned_over"])]
    assert refused(folder, rows) == []
    assert not (folder / "new.yaml").exists()
    page = json.loads(done("measure", *words.split(), "--accept", "turned_over", "--json"))
    assert page["doubts"] == ["turned_over"]
    assert page["tilt"] == pytest.approx(np.pi, abs=1e-6)


def test_the_difference_from_the_planned_frame_is_printed(folder, done):
    page = json.loads(done("measure", "part", "touches.csv", "--job", "job.yaml", "--json"))
    assert page["shift"] == pytest.approx([-0.02, 0.0, 0.0], abs=1e-6)
    assert page["turn"] == pytest.approx(0.3 - np.radians(10), abs=1e-6)
    assert page["scale"] == pytest.approx(1.0, abs=1e-6)
    assert page["unchecked"] == ["the tool centre point"]


REFUSED = [
    ("part touches.csv --job job.yaml --accept upside", ["upside", "turned_over"]),
    ("part touches.csv --job job.yaml --out job.yaml", ["job.yaml exists", "--force"]),
    ("part touches.csv --job job.yaml --force", ["--force requires --out"]),
    ("part touches.csv --job drawing.dxf", ["--job must be a job file"]),
    ("tool touches.csv --job job.yaml", ["touches.csv", "x, y and z are not allowed"]),
    ("part touches.csv --job job.yaml --noise 0.1", ["--noise", "unit"]),
    ("part missing.csv --job job.yaml", ["missing.csv"]),
    ("part radians.csv --job job.yaml", ["radians.csv, line 1", "no unit", "q1 [deg]"]),
    ("part five.csv --job job.yaml", ["five.csv", "q6"]),
    ("part empty.csv --job job.yaml", ["empty.csv, line 2", "not a finite number"]),
]


def test_invalid_tables_and_options_are_refused(folder, refused):
    table = (folder / "touches.csv").read_text()
    (folder / "radians.csv").write_text(table.replace(" [deg]", ""))
    (folder / "five.csv").write_text(table.replace("q6 [deg]", "other"))
    header, first, *rest = table.split("\n")
    cells = first.split(",")
    cells[4] = ""
    (folder / "empty.csv").write_text("\n".join([header, ",".join(cells), *rest]))
    rows = [(f"measure {line}", words) for line, words in REFUSED]
    assert refused(folder, rows) == []


def test_job_itself_is_replaced_with_force(folder, done):
    done("measure", "part", "touches.csv", "--job", "job.yaml", "--out", "job.yaml", "--force")
    np.testing.assert_allclose(
        ac.read_job(folder / "job.yaml").part.position, TRUE.position, atol=1e-7
    )
