"""Pictures to take along: the drawing as SVG, by the code that draws the screen, run by node."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, compute

from armcontour.studio.executed import executed_frame
from armcontour.studio.picture import picture_frame
from armcontour.studio.wire import Frame

pytestmark = pytest.mark.skipif(NODE is None, reason="the page's drawing is run by node")
SVG = "{http://www.w3.org/2000/svg}"
WIDTH, HEIGHT, SCALE = 700, 400, 1500.0
SHEET = """
globalThis.document = { documentElement: { dataset: { theme: "light" } } };
const inks = { "--band": "rgba(0, 114, 178, 0.10)", "--executed": "#0072b2" };
const getPropertyValue = (name) => inks[name] ?? "#123456";
globalThis.getComputedStyle = () => ({ getPropertyValue });
const { Store } = await import("./state.js");
const { unpack } = await import("./wire.js");
const { Viewport } = await import("./viewport.js");
const { Layers } = await import("./layers.js");
const { SvgContext, Trace } = await import("./svg.js");
const { drawingSheet } = await import("./sheet.js");
const store = new Store();
for (const data of given.frames) store.put(unpack(new Uint8Array(data).buffer));
Object.assign(store.options, given.options ?? {});
for (const x of given.captions ?? []) store.underlays.add({ paint() {}, caption: () => x });
const { width, height, scale } = given;
const view = Object.assign(new Viewport(), { width, height, scale, u: 0.01, v: -0.02 });
const measure = (text, font) => 0.6 * text.length * Number(/([\\d.]+)px/.exec(font)[1]);
const layers = new Layers(store, Trace, 0);
const sheet = drawingSheet(store, layers, view, new SvgContext(1, 1, measure));
const context = new SvgContext(sheet.width, sheet.height, measure);
sheet.paint(context);
const size = { width: sheet.width, height: sheet.height };
tell({ text: context.file(sheet.title), ...size, factor: layers.factor });
"""


@pytest.fixture(scope="module")
def planned(plans):
    return plans["optimal"]


@pytest.fixture(scope="module")
def shown(planned, previewer_of_plans, view):
    """Frames of the paper's job."""
    executed = previewer_of_plans.execute(planned)
    return picture_frame(planned, view), executed_frame(executed, view)


def take(*frames, **more):
    """The picture that the page makes of frames, read again, and what was told of it."""
    size = {"width": WIDTH, "height": HEIGHT, "scale": SCALE}
    found = compute(SHEET, {"frames": [list(x.pack()) for x in frames], **size, **more})
    return ET.fromstring(found["text"]), found


def document(**more):
    return Frame("document", {"rev": 0, "name": "paper", "pins": [], "compare": None, **more}, {})


def words(svg):
    return [x.text.replace("\xa0", " ") for x in svg.iter(f"{SVG}text")]


def paths(svg, attribute, value):
    return [x for x in svg.iter(f"{SVG}path") if x.get(attribute) == value]


def points_of(element):
    """Points of a path [px]."""
    text = element.get("d").replace("M", " ").replace("L", " ").replace("Z", " ")
    return np.array(text.split(), dtype=float).reshape(-1, 2)


def on_screen(points, svg):
    """Where the sheet has points of the picture [m]; its view begins below the title."""
    x = WIDTH / 2 + (points[:, 0] - 0.01) * SCALE
    return np.column_stack([x, top_of(svg) + HEIGHT / 2 - (points[:, 1] + 0.02) * SCALE])


def top_of(svg):
    """Where the view begins: its clip [px]."""
    return points_of(svg.find(f"{SVG}clipPath/{SVG}path"))[:, 1].min()


def away(drawn, expected):
    """Distances of points from points."""
    return np.abs(drawn[:, None] - expected).max(axis=2)


def test_path_title_legend_and_scales_are_in_the_file(shown, planned):
    picture, executed = shown
    svg, told = take(document(), picture, executed)
    strokes, limits = paths(svg, "stroke-width", "3.2"), picture.header["limits"]
    kinds = {limits[k]["kind"] if k < 255 else "other" for k in picture.arrays["binding"]}
    assert len(strokes) == len(kinds)
    # Hundredths of a pixel are written; every point of the path is drawn, and nothing else.
    drawn = np.vstack([points_of(x) for x in strokes])
    found = away(drawn, on_screen(picture.arrays["path"], svg))
    assert found.min(axis=1).max() < 0.006 and found.min(axis=0).max() < 0.016
    tool = points_of(paths(svg, "stroke-width", "1.3")[0])
    magnified = executed.arrays["base"] + told["factor"] * executed.arrays["offset"]
    assert away(tool, on_screen(magnified, svg)).min(axis=1).max() < 0.01
    assert told["factor"] > 1
    said = words(svg)
    assert said[0] == "paper, run optimal"
    assert f"cycle time {planned.trajectory.duration:.3f} s" in said[1]
    assert "contour error" in said[1] and "(preview)" in said[1]
    legend = {"joint acceleration", "objective", "corner tolerance", "slow place", "50 mm"}
    assert {*legend, f"executed tool, error ×{told['factor']}"} <= set(said)
    assert any(x.endswith("mm of error") for x in said)
    # The bar is as long as it says.
    bar = points_of(paths(svg, "stroke-width", "2")[0])
    assert np.ptp(bar[:, 0]) == pytest.approx(0.05 * SCALE)
    assert (float(svg.get("width")), float(svg.get("height"))) == (told["width"], told["height"])
    assert told["width"] == WIDTH and told["height"] > HEIGHT


def test_texts_stay_within_the_picture_which_is_of_whole_pixels(shown):
    caption = "a place of the part and more words " * 4
    svg, told = take(document(), *shown, width=319.3, height=300.6, captions=[caption])
    assert told["width"] == 320 and told["height"] == int(told["height"]) > 300.6
    ground = svg.find(f"{SVG}rect")
    assert [float(ground.get(x)) for x in ("width", "height")] == [320, told["height"]]
    low, high = top_of(svg), top_of(svg) + 300.6
    for x in svg.iter(f"{SVG}text"):
        left, y = float(x.get("x")), float(x.get("y"))
        if not low < y < high:
            assert 0 < left < left + 0.6 * len(x.text) * float(x.get("font-size")) <= 320, x.text
            assert 0 < y < told["height"]
    assert sum(x.split().count("part") for x in words(svg)) == 4


def test_names_are_text_and_nothing_else(shown):
    name = 'a <b> & "c"</svg><script>1</script>\x01'
    svg, _ = take(document(name=name), *shown)
    assert words(svg)[0] == f"{name[:-1]}, run optimal"
    tags = {"svg", "title", "clipPath", "g", "path", "rect", "text"}
    assert {x.tag.removeprefix(SVG) for x in svg.iter()} == tags
    for x in svg.iter():
        assert not {k for k in x.keys() if k.startswith("on") or "href" in k or k == "style"}
        assert all("url(" not in v or v.startswith("url(#clip") for v in x.attrib.values())


def test_the_place_of_a_refusal_is_in_the_file(shown):
    at, sentence = [0.35, 0.2], "The path is out of reach."
    head = {"rev": 0, "seq": 9, "tier": 1, "sentence": sentence, "at": {"uv": at}}
    svg, _ = take(document(), *shown, Frame("refusal", head, {}), options={"colour": "error"})
    said = words(svg)
    assert f"Refused: {sentence}" in said
    cross = next(x for x in paths(svg, "stroke-width", "3") if x.get("d").count("M") == 2)
    place = on_screen(np.array([at]) - shown[0].header["centre"], svg)
    assert points_of(cross).mean(axis=0) == pytest.approx(place[0], abs=0.02)
    # There is no execution, so there are no errors: the legend says what is drawn.
    assert "joint acceleration" in said
    assert not [x for x in said if x.startswith(("error", "executed"))]


def test_a_compared_variant_and_obstacles_are_in_the_file(shown, planned, view):
    other = picture_frame(planned, view, of="compare")
    where = {"at": [0.3, 0.2, 0.0], "rpy": [0, 0, 0], "size": [0.04, 0.02, 0.01]}
    box = {"kind": "boxes", "index": 0, **where}
    found = document(compare={"pin": 1}, pins=[{"pin": 1, "name": "slow"}], obstacles=[box])
    svg, _ = take(found, *shown, other)
    (told,) = (x for x in words(svg) if x.startswith("compared with slow"))
    assert told.endswith(f"cycle time {planned.trajectory.duration:.3f} s")
    drawn = points_of(paths(svg, "fill-opacity", "0.22")[0])
    corners = np.array([[x, y] for x in (0.28, 0.32) for y in (0.19, 0.21)])
    expected = on_screen(corners - view.plane.origin[:2] - shown[0].header["centre"], svg)
    assert len(drawn) == 4 and away(drawn, expected).min(axis=0).max() < 0.02
