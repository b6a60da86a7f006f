"""The command `show` for CAD models: parts, seams, edges, contours, and the picture."""

import json
import re

import numpy as np
import pytest

pytest.importorskip("OCP")
from tests.files.model import step_parts

SEAM = "{seams: [post, plate], open: 200 mm}"


@pytest.fixture(scope="module")
def frame(tmp_path_factory):
    return step_parts.frame(tmp_path_factory.mktemp("show") / "frame.step")


def test_show_lists_parts_seams_edges_and_contours(done, frame):
    printed = done("show", frame, "--edges", SEAM)
    assert "380.00 x 200.00 x 312.00 mm" in printed
    for row in (r"plate .*200\.00 .*200\.00 .*12\.00 .*6 .*#808080", r"plate, post .*8 .*448\.00"):
        assert re.search(row, printed)
    assert re.search(r"29 .*line .*concave .*-90\.0 .*300\.00", printed)
    assert re.search(r"seam post/plate .*yes .*240\.00", printed)


def test_show_prints_json_of_all_edges(done, frame):
    page = json.loads(done("show", frame, "--json", "--edges", SEAM))
    assert [x["name"] for x in page["parts"]] == ["plate", "post", "arm"]
    assert len(page["edges"]) == 60 and page["unit"] == pytest.approx(1e-3)
    assert page["edges"][0]["radius"] is None
    assert page["contours"][0]["length"] == pytest.approx(0.24)
    np.testing.assert_allclose(page["extent"], [[-0.1, -0.1, 0], [0.28, 0.1, 0.312]], atol=1e-9)


def arrows(page):
    """Tips and tails of the arrows in a page [px], (n, 2) each."""
    (d,) = re.findall(r'class="tool-axis" d="M([^"]+)"', page)
    numbers = [np.array(x.split(), dtype=float).reshape(-1, 2) for x in d.split("M")]
    return np.array([x[1] for x in numbers]), np.array([x[0] for x in numbers])


def test_the_picture_shows_the_tool_axes(done, command, frame, tmp_path):
    file = tmp_path / "frame.html"
    done("show", frame, "--edges", SEAM, "--out", file)
    tips, tails = arrows(file.read_text(encoding="utf-8"))
    assert len(tips) >= 4
    # The tool comes from above, so tails are higher, which is a smaller y in SVG.
    assert (tails[:, 1] < tips[:, 1]).mean() > 0.9
    assert command("show", frame, "--out", file).code == 2
    done("show", frame, "--out", file, "--force")
    assert "tool-axis" not in re.sub(
        r"<style>.*?</style>", "", file.read_text(encoding="utf-8"), flags=re.S
    )


def test_the_orientation_turns_the_arrows(done, frame, tmp_path):
    file = tmp_path / "up.html"
    edges = "{face: {near: [90 mm, 0, 12 mm]}}"
    done("show", frame, "--edges", edges, "--orientation", "{face: {}}", "--out", file)
    tips, tails = arrows(file.read_text(encoding="utf-8"))
    np.testing.assert_allclose(tips[:, 0], tails[:, 0], atol=0.2)


def test_options_of_models_are_refused_for_drawings(command, tmp_path):
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n0,0\n30,0\n")
    for option in (
        ("--out", "a.html"),
        ("--edges", "{fold: convex}"),
        ("--orientation", "{face: {}}"),
    ):
        ended = command("show", tmp_path / "line.csv", *option)
        assert ended.code == 2 and "CAD model" in ended.errors


def test_many_edges_are_counted_by_kind(done, tmp_path):
    holes = [
        step_parts.cylinder(2, 20, (x, y, -5)) for x in range(5, 45, 8) for y in range(5, 45, 8)
    ]
    shape = step_parts.cut(step_parts.box((0, 0, 0), (50, 50, 5)), *holes)
    file = step_parts.write(tmp_path / "plate.step", step_parts.Named("plate", shape))
    printed = done("show", file)
    assert re.search(r"circle .*convex .*2\.000 .*50 ", printed)
    assert "62 edges" in printed
