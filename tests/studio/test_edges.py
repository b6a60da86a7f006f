"""Edges of a CAD model are picked: the server writes rules, and the page gets model and arrows."""

import numpy as np
import pytest
from tests.files.model.conftest import steps
from tests.studio.session_pages import SessionPage, session_of
from tests.studio.test_arithmetic import NODE, compute

import armcontour as ac
from armcontour.core.yaml_loader import load
from armcontour.studio.edits.edges import MOST_SINGLE

__all__ = ["steps"]

JOB = """\
name: block
arm: ur10e
path:
  file: {file}
  edges: []   # none yet
  frame: {{position: [600 mm, -50 mm, 100 mm]}}
limits: {{speed: 50 mm/s}}
corners: {{tolerance: 0.5 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
scene: {{model: none}}
runs: {{own: {{}}}}
"""


@pytest.fixture
def page_of(steps, tmp_path):
    """Opens a job of a model; returns a page that has received the model."""
    opened = []

    def open_page(name, text=JOB):
        (tmp_path / name).write_bytes((steps / name).read_bytes())
        file = tmp_path / "job.yaml"
        file.write_text(text.format(file=name))
        session = session_of(file)
        opened.append(session)
        page = SessionPage(session)
        session.begin()
        session.wait_for_model()
        return page

    yield open_page
    for session in opened:
        session.close()


def rules_of(page):
    return load(page.last("document")["text"], "job")["path"]["edges"]


def edges_where(page, **facts):
    """Numbers of the edges in the frame `model` that have values."""
    edges = page.last("model")["edges"]
    return [k for k, x in enumerate(edges) if all(x[name] == y for name, y in facts.items())]


def selected(page):
    return {k for k, _ in page.last("document")["model"]["selected"]}


def polyline(page, edge):
    frame = next(x for x in reversed(page.frames) if x.kind == "model")
    begin, end = frame.arrays["breaks"][edge : edge + 2]
    return frame.arrays["points"][begin:end]


def test_a_model_without_selected_edges_is_shown_with_the_arm_and_no_plan(page_of):
    page = page_of("block.step")
    model = page.last("model")
    assert model["sentence"] is None and model["parts"] == ["block"]
    circles = edges_where(page, kind="circle")
    holes = [k for k in circles if model["edges"][k]["radius"] == pytest.approx(0.005)]
    assert len(holes) == 4
    for k in holes:
        points = polyline(page, k)
        centre = np.array([points[:, 0].max() + points[:, 0].min(), 0.06]) / 2
        distances = np.linalg.norm(points[:, :2] - centre, axis=1)
        assert distances == pytest.approx(np.full(len(points), 0.005), abs=1e-6)
    kinds = {x.kind for x in page.frames}
    assert "arm" in kinds and "refusal" not in kinds
    assert not page.last("picture")["contours"] and not selected(page)
    assert not page.last("document")["path"]["editable"]


def test_a_picked_edge_becomes_a_rule_by_a_point_on_it_and_undo_is_exact(page_of):
    page = page_of("block.step")
    before = page.last("document")["text"]
    edge = next(k for k in edges_where(page, kind="line", fold="convex"))
    page.edit({"do": "pick", "edge": edge})
    (rule,) = rules_of(page)
    near = [float(x.removesuffix(" mm")) / 1e3 for x in rule["near"]]
    start, end = polyline(page, edge)
    assert near == pytest.approx(list((start + end) / 2), abs=1e-5)
    assert selected(page) == {edge}
    assert len(page.last("picture")["contours"]) == 1
    assert page.last("document")["undo_label"]
    page.say("undo")
    assert page.last("document")["text"] == before and not selected(page)


def test_all_edges_like_one_become_one_rule_that_replaces_those_of_its_edges(page_of):
    page = page_of("block.step")
    group = page.last("model")["edges"][edges_where(page, kind="circle")[0]]["group"]
    holes = page.last("model")["groups"][group]["edges"]
    line = edges_where(page, kind="line", fold="convex")[0]
    for edge in (line, holes[0]):
        page.edit({"do": "pick", "edge": edge})
    page.edit({"do": "pick", "edge": holes[1], "like": True})
    one, like = rules_of(page)
    assert list(one) == ["near"] and like["kind"] == "circle"
    assert selected(page) == {line, *holes}
    page.edit({"do": "unpick", "edge": holes[2]})
    assert selected(page) == {line, *holes} - {holes[2]}
    page.edit({"do": "unpick", "edge": line, "like": True})
    assert selected(page) == set(holes) - {holes[2]}
    for edge in set(holes) - {holes[2]}:
        page.edit({"do": "unpick", "edge": edge})
    assert rules_of(page) == [] and not page.last("picture")["contours"]
    assert "# none yet" in page.last("document")["text"]


def test_a_seam_is_picked_instead_of_the_edge_below_it_and_has_both_faces(page_of):
    page = page_of("frame.step")
    model = page.last("model")
    seams = [k for k in edges_where(page) if model["edges"][k]["seam"] == ["plate", "post"]]
    covered = edges_where(page, covered=True)
    assert len(seams) == 8 and not set(seams) & set(covered)
    outside = [x for x in model["groups"] if "open" in x["rule"] and "plate" in x["rule"]]
    assert len(outside) == 1 and len(outside[0]["edges"]) == 4
    edge = outside[0]["edges"][0]
    page.edit({"do": "pick", "edge": edge, "like": True})
    assert selected(page) == set(outside[0]["edges"])
    frame = next(x for x in reversed(page.frames) if x.kind == "picture")
    axes = frame.arrays["tool_axes"]
    shafts = axes[: len(axes) // 3, 1] - axes[: len(axes) // 3, 0]
    down = shafts[:, 2] / np.linalg.norm(shafts, axis=1)
    # Between corners, the tool is at 45 degrees to the plate.
    assert np.median(down) == pytest.approx(-np.sqrt(0.5), abs=1e-3)


def test_the_knob_turns_about_the_seam_as_the_work_angle_does(page_of):
    page = page_of("frame.step")
    seam = page.last("model")["groups"]
    group = next(x for x in seam if "open" in x["rule"] and "plate" in x["rule"])
    page.edit({"do": "pick", "edge": group["edges"][0]})
    (before,) = page.last("picture")["knobs"]
    page.edit({"do": "set", "key": "path.orientation.bisector.work", "value": "1"})
    orientation = load(page.last("document")["text"], "job")["path"]["orientation"]
    assert orientation == {"bisector": {"work": "1 deg"}}
    (after,) = page.last("picture")["knobs"]
    moved = np.subtract(after["tail"], before["tail"])
    angle = np.radians(1)
    assert moved == pytest.approx(np.array(before["turn"]) * angle, abs=1e-5)
    assert after["tip"] == pytest.approx(before["tip"])


def test_the_program_of_picked_edges_is_that_of_the_library(page_of, steps, tmp_path):
    page = page_of("saddle.step")
    groups = page.last("model")["groups"]
    group = next(x for x in groups if "open" in x["rule"])
    page.edit({"do": "pick", "edge": group["edges"][0], "like": True})
    file = tmp_path / "copy.yaml"
    file.write_text(page.last("document")["text"])
    job = ac.read_job(file)
    assert len(job.program.contours) == len(page.last("picture")["contours"]) == 1


def test_edits_without_sense_are_refused_and_change_nothing(page_of):
    page = page_of("block.step")
    text = page.last("document")["text"]
    count = len(page.last("model")["edges"])
    for edit in (
        {"do": "pick", "edge": count},
        {"do": "pick", "edge": "first"},
        {"do": "pick"},
        {"do": "unpick", "edge": 0},
    ):
        frames = page.edit(edit)
        assert "refusal" in {x.kind for x in frames}, edit
        assert page.last("document")["text"] == text
    page.edit({"do": "pick", "edge": 0})
    text = page.last("document")["text"]
    page.edit({"do": "pick", "edge": 0})
    assert page.last("refusal")["dropped"] and page.last("document")["text"] == text


def test_a_single_edge_of_many_is_not_removed_from_their_rule(page_of):
    page = page_of("sheet.step")
    curves = edges_where(page, kind="curve")
    assert len(curves) > MOST_SINGLE + 1
    page.edit({"do": "pick", "edge": curves[0], "like": True})
    text = page.last("document")["text"]
    page.edit({"do": "unpick", "edge": curves[0]})
    assert str(len(curves)) in page.last("refusal")["sentence"]
    assert page.last("document")["text"] == text


def test_a_changed_file_is_read_again_and_a_broken_one_is_a_sentence(page_of, steps, tmp_path):
    page = page_of("block.step")
    session = page.session
    (tmp_path / "block.step").write_bytes((steps / "saddle.step").read_bytes())
    page.say("reload")
    session.wait_for_model()
    assert page.last("model")["parts"] == ["main pipe", "branch"]
    (tmp_path / "block.step").write_bytes(b"nothing")
    page.say("reload")
    session.wait_for_model()
    assert "not a STEP file" in page.last("model")["sentence"]
    frames = page.edit({"do": "pick", "edge": 0})
    assert "refusal" in {x.kind for x in frames}


def test_an_opened_model_starts_without_edges_and_its_cells_direction_is_removed(
    page_of, steps, tmp_path
):
    page = page_of("block.step")
    session = page.session
    content = (steps / "saddle.step").read_bytes()
    session.open_upload("saddle.step", content, "ur10e")
    session.wait_for_model()
    assert rules_of(page) == [] and page.last("model")["parts"] == ["main pipe", "branch"]
    page.edit({"do": "set", "key": "path.orientation", "value": {"axis": [0, 0, -1]}})
    session.open_upload("block.step", (steps / "block.step").read_bytes(), None)
    session.wait_for_model()
    path = load(page.last("document")["text"], "job")["path"]
    assert path["edges"] == [] and "orientation" not in path
    # A page that joins later has the model as well.
    later = SessionPage(session)
    assert later.last("model")["parts"] == ["block"]


def test_a_job_without_edges_is_refused_outside_of_the_page(steps, tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB.format(file=steps / "block.step"))
    with pytest.raises(ac.InvalidInput, match="empty") as caught:
        ac.read_job(file)
    assert caught.value.key == ("path", "edges")


# Looks along z from a height of 10 m at lines along x, on a canvas of 100 px for 1 m.
PICK = """
const { ScreenEdges } = await import("./edge_pick.js");
const edges = new ScreenEdges({
  points: new Float32Array(given.points), breaks: new Uint32Array(given.breaks),
  triangles: new Float32Array(given.triangles),
}, given.skipped);
// Columns of a projection with the eye at (0, 0, 10).
edges.project([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, -0.1, 0, 0, 0, 1], 100, 100);
tell(given.places.map(([x, y, hidden]) => edges.at(x, y, 12, [0, 0, 10], hidden)?.edge ?? -1));
"""


@pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")
def test_the_page_picks_the_nearest_edge_that_the_part_does_not_hide():
    # Lines at y = 0 and y = 0.1, of which the first one is below a triangle.
    given = {
        "points": [-0.2, 0, 0, 0.2, 0, 0, -0.2, 0.1, 0, 0.2, 0.1, 0],
        "breaks": [0, 2, 4],
        "triangles": [-1, 0.05, 1, 1, 0.05, 1, 0, -5, 1],
        "skipped": [False, False],
        "places": [[50, 46, 8], [50, 46, 0], [50, 53, 8], [50, 20, 8], [95, 50, 0]],
    }
    # The second line is 6 px from the first place, and the first line 4 px.
    assert compute(PICK, given) == [1, 0, 0, -1, -1]
    assert compute(PICK, {**given, "skipped": [True, False]})[1] == 1
