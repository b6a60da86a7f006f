"""Pictures to take along: the drawing as SVG, by the code that draws the screen, run by node."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, compute

from armcontour.studio.executed import executed_frame
from armcontour.studio.picture import picture_frame
from armcontour.studio.preview import Previewer
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


@pytest.fixture
def planned(paper, tmp_path):
    return Previewer(tmp_path).plan(paper, "optimal")


@pytest.fixture
def shown(planned, view, tmp_path):
    """Frames of the paper's job."""
    executed = Previewer(tmp_path).execute(planned)
    return picture_frame(planned, view), executed_frame(executed, view)


def take(frames, **more):
    """The picture that the page makes of frames, read again, and what was told of it."""
    given = {
        "frames": [list(x.pack()) for x in frames],
        "width": WIDTH,
        "height": HEIGHT,
        "scale": SCALE,
    }
    found = compute(SHEET, {**given, **more})
    return ET.fromstring(found["text"]), found


def document(**more):
    return Frame("document", {"rev": 0, "name": "paper", "pins": [], "compare": None, **more}, {})


def words(svg):
    return [x.text.replace("\xa0", " ") for x in svg.iter(f"{SVG}text")]


def points_of(element):
    """Points of a path [px]."""
    text = element.get("d").replace("M", " ").replace("L", " ").replace("Z", " ")
    return np.array(text.split(), dtype=float).reshape(-1, 2)


def on_screen(points, top):
    """Where the sheet has points of the picture [m]; its view begins below the title."""
    return np.column_stack(
        [
            WIDTH / 2 + (points[:, 0] - 0.01) * SCALE,
            top + HEIGHT / 2 - (points[:, 1] + 0.02) * SCALE,
        ]
    )


def top_of(svg):
    """Where the view begins: its clip [px]."""
    return points_of(svg.find(f"{SVG}clipPath/{SVG}path"))[:, 1].min()


def test_the_path_is_in_the_file_where_the_plan_has_it(shown):
    picture, executed = shown
    svg, told = take([document(), picture, executed])
    top = top_of(svg)
    strokes = [x for x in svg.iter(f"{SVG}path") if x.get("stroke-width") == "3.2"]
    kinds = {
        picture.header["limits"][k]["kind"] if k < 255 else "other"
        for k in picture.arrays["binding"]
    }
    assert len(strokes) == len(kinds)
    expected = on_screen(picture.arrays["path"], top)
    drawn = np.vstack([points_of(x) for x in strokes])
    # Hundredths of a pixel are written; every point of the path is drawn, and nothing else.
    away = np.abs(drawn[:, None] - expected).max(axis=2)
    assert away.min(axis=1).max() < 0.006 and away.min(axis=0).max() < 0.016
    tool = next(x for x in svg.iter(f"{SVG}path") if x.get("stroke-width") == "1.3")
    magnified = executed.arrays["base"] + told["factor"] * executed.arrays["offset"]
    away = np.abs(points_of(tool)[:, None] - on_screen(magnified, top)).max(axis=2)
    assert away.min(axis=1).max() < 0.01
    assert told["factor"] > 1


def test_title_legend_and_scales_are_in_the_file(shown, planned):
    svg, told = take([document(), *shown])
    said = words(svg)
    assert said[0] == "paper, run optimal"
    assert f"cycle time {planned.trajectory.duration:.3f} s" in said[1]
    assert "contour error" in said[1] and "(preview)" in said[1]
    assert {"joint acceleration", "objective", "corner tolerance", "slow place", "50 mm"} <= set(
        said
    )
    assert f"executed tool, error ×{told['factor']}" in said
    assert any(x.endswith("mm of error") for x in said)
    assert svg.find(f"{SVG}title").text.startswith("paper, run optimal\n")
    # The bar is as long as it says.
    bars = [points_of(x) for x in svg.iter(f"{SVG}path") if x.get("stroke-width") == "2"]
    assert np.ptp(bars[0][:, 0]) == pytest.approx(0.05 * SCALE)
    assert (float(svg.get("width")), float(svg.get("height"))) == (told["width"], told["height"])
    assert told["width"] == WIDTH and told["height"] > HEIGHT


def test_texts_stay_within_the_picture(shown):
    svg, _ = take(
        [document(), *shown], width=320, captions=["a place of the part and more words " * 4]
    )
    low, high = top_of(svg), top_of(svg) + HEIGHT
    for x in svg.iter(f"{SVG}text"):
        y = float(x.get("y"))
        inside = low < y < high
        if inside:
            continue
        end = float(x.get("x")) + 0.6 * len(x.text) * float(x.get("font-size"))
        assert 0 < float(x.get("x")) < end <= 320, x.text
        assert 0 < y < float(svg.get("height"))
    assert sum(x.split().count("part") for x in words(svg)) == 4


def test_pictures_are_of_whole_pixels(shown):
    svg, told = take([document(), *shown], width=600.3, height=300.6)
    assert told["width"] == 601 and told["height"] == int(told["height"]) > 300.6
    ground = svg.find(f"{SVG}rect")
    assert [float(ground.get(x)) for x in ("width", "height")] == [601, told["height"]]


def test_names_are_text_and_nothing_else(shown):
    name = 'a <b> & "c"</svg><script>1</script>\x01'
    svg, _ = take([document(name=name), *shown])
    assert words(svg)[0] == f"{name[:-1]}, run optimal"
    assert {x.tag.removeprefix(SVG) for x in svg.iter()} == {
        "svg",
        "title",
        "clipPath",
        "g",
        "path",
        "rect",
        "text",
    }
    for x in svg.iter():
        assert not {k for k in x.keys() if k.startswith("on") or "href" in k or k == "style"}
        assert all("url(" not in v or v.startswith("url(#clip") for v in x.attrib.values())


def test_the_place_and_the_sentence_of_a_refusal_are_in_the_file(shown, view):
    at = [0.35, 0.2]
    head = {
        "rev": 0,
        "seq": 9,
        "tier": 1,
        "sentence": "The path is out of reach.",
        "at": {"uv": at},
    }
    svg, _ = take([document(), *shown, Frame("refusal", head, {})], options={"colour": "error"})
    said = words(svg)
    assert "Refused: The path is out of reach." in said
    assert "of the last motion that was possible" in " ".join(said[:4])
    cross = next(
        x
        for x in svg.iter(f"{SVG}path")
        if x.get("stroke-width") == "3" and x.get("d").count("M") == 2
    )
    centre = np.array(shown[0].header["centre"])
    place = on_screen(np.array([at]) - centre, top_of(svg))
    assert points_of(cross).mean(axis=0) == pytest.approx(place[0], abs=0.02)
    # There is no execution, so there are no errors: the legend says what is drawn.
    assert "joint acceleration" in said and not [
        x for x in said if x.startswith(("error", "executed"))
    ]


def test_a_compared_variant_and_obstacles_are_in_the_file(shown, planned, view):
    other = picture_frame(planned, view, of="compare")
    box = {
        "kind": "boxes",
        "index": 0,
        "at": [0.3, 0.2, 0.0],
        "rpy": [0, 0, 0],
        "size": [0.04, 0.02, 0.01],
    }
    found = document(compare={"pin": 1}, pins=[{"pin": 1, "name": "slow"}], obstacles=[box])
    svg, _ = take([found, *shown, other])
    said = words(svg)
    duration = f"cycle time {planned.trajectory.duration:.3f} s"
    assert [x for x in said if x.startswith("compared with slow")][0].endswith(duration)
    assert "compared" in said
    outline = next(x for x in svg.iter(f"{SVG}path") if x.get("fill-opacity") == "0.22")
    centre = np.array(shown[0].header["centre"])
    corners = np.array([[x, y] for x in (0.28, 0.32) for y in (0.19, 0.21)])
    expected = on_screen(corners - view.plane.origin[:2] - centre, top_of(svg))
    drawn = points_of(outline)
    assert len(drawn) == 4
    assert np.abs(drawn[:, None] - expected).max(axis=2).min(axis=0).max() < 0.02
