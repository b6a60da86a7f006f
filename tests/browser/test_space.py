"""Tools in space: the gizmo, obstacles of every kind, measuring, and bodies that collide."""

import math
import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.dynamics_extra import needs_dynamics
from tools.studio_page import TWO_FRAMES

from armcontour.core.yaml_loader import load

pytestmark = [pytest.mark.browser, needs_dynamics]
POINTS = "points: [[0, 0, 0], [0.06, 0, 0], [0.06, 0.03, 0], [0, 0.03, 0], [0, 0, 0]]"
JOB = f"""\
name: cell
arm: {{name: ur5e, work: {{position: [0.4, -0.05, 0.2]}}}}
path:
  {POINTS}
  frame: {{position: [10 mm, 12 mm, 0 mm]}}
  orientation: {{axis: [0, 0, -1]}}
limits: {{speed: 50 mm/s}}
corners: {{tolerance: 1 mm}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
cycle: 4 ms
runs: {{only: {{}}}}
"""
POST = """\
scene:
  obstacles:
    - {type: box, name: post, size: [20 mm, 20 mm, 100 mm], at: [470 mm, 0 mm, 260 mm]}
    - {type: sphere, name: ball, radius: 20 mm, at: [0.3, 0.4, 0.4]}
"""
# Two balls around the wrist at the start of the motion.
TWO_AT_START = """\
scene:
  obstacles:
    - {type: sphere, name: one, radius: 30 mm, at: [0.41, -0.038, 0.27]}
    - {type: sphere, name: other, radius: 30 mm, at: [0.41, -0.038, 0.27]}
"""
# A tap of a finger at a place of the page.
TAP = """(svg, [x, y]) => {
    svg.setPointerCapture = () => {};
    const how = { clientX: x, clientY: y, pointerId: 7, pointerType: "touch", bubbles: true };
    svg.dispatchEvent(new PointerEvent("pointerdown", how));
    svg.dispatchEvent(new PointerEvent("lostpointercapture", how));
    delete svg.setPointerCapture;
}"""
# Two squares of 20 mm beside a circle of 10 mm radius, whose centre is 50 mm from the first corner.
DRAWING = """\
<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="60mm" viewBox="0 0 100 60">
<rect x="10" y="10" width="20" height="20"/><circle cx="60" cy="20" r="10"/></svg>
"""
STL = """\
solid tile
facet normal 0 0 1
outer loop
vertex 0 0 0
vertex 40 0 0
vertex 0 40 0
endloop
endfacet
facet normal 0 0 1
outer loop
vertex 0 0 20
vertex 40 0 20
vertex 0 40 20
endloop
endfacet
endsolid tile
"""


@pytest.fixture
def cell(page, folder):
    """A page that shows the job, with the arm beside the drawing."""
    return shown(page, folder, JOB)


def shown(page, folder, text, name="other.yaml"):
    """Open a job in the page."""
    file = folder / name
    file.write_text(text)
    page.open(file)
    page.page.keyboard.press("Escape")
    # No tool of an earlier test is used.
    page.find("#view2d").press("v")
    page.find("#viewbar").get_by_role("button", name="Both").click()
    page.wait_for("#view3d canvas")
    return page


def data_of(studio):
    return load(studio.text, "")


def millimetres(values):
    """Lengths of a job file in mm."""
    numbers = []
    for x in values:
        number = float(str(x).removesuffix(" mm"))
        numbers.append(number if str(x).endswith(" mm") else 1000 * number)
    return numbers


def rotation_by(angle):
    """The rotation by an angle in the plane [rad], (2, 2)."""
    cosine = math.cos(angle)
    sine = math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]])


def grip(studio, axis):
    return studio.find(f".gizmo-grip[data-axis='{axis}']")


def points_of(studio, axis, part):
    """Points of an arrow or of the ring of the gizmo, which stands still, in the canvas [px]."""
    line = grip(studio, axis).locator(f"{part}[d]")
    # The view follows the first motion of a job.
    before = ""
    while before != line.get_attribute("d"):
        before = line.get_attribute("d")
        studio.page.wait_for_timeout(400)
    return np.array(re.findall(r"([-\d.]+) ([-\d.]+)", before), dtype=float)


def origin_of(studio):
    """Where the origin of the gizmo is on the page [px]; arrows begin at 16 % of their length."""
    ends = points_of(studio, 2, ".target")
    box = studio.find("#view3d canvas").bounding_box()
    return [box["x"], box["y"]] + ends[0] - 0.16 / 0.84 * (ends[1] - ends[0])


def test_gizmo_raises_the_part_in_steps_of_5_mm_and_the_arm_follows(cell):
    cell.rest()
    height = float(cell.told("#view3d", "tool").split(",")[2])
    cell.page.keyboard.press("g")
    figure = cell.find(".gizmo-figure")
    with cell.changing():
        with cell.grabbing(grip(cell, 2)) as (x, y):
            cell.page.mouse.move(x, y - 30, steps=6)
            expect(figure).to_contain_text(re.compile(r"Z \+\d"))
            # The arm is at the new height before the button is released.
            cell.wait_for(f"#view3d:not([data-tool$=',{height}'])")
    raised = millimetres(data_of(cell)["path"]["frame"]["position"])
    assert raised[2] > 0 and raised[2] % 5 == 0
    assert raised[:2] == [10, 12]
    now = float(cell.told("#view3d", "tool").split(",")[2])
    assert now - height == pytest.approx(raised[2] / 1000, abs=1e-6)
    expect(figure).to_be_hidden()
    # The whole drag is one step of undo.
    with cell.changing():
        cell.find("#undo").click()
    assert millimetres(data_of(cell)["path"]["frame"]["position"]) == [10, 12, 0]


def test_ring_turns_the_part_about_its_middle_and_shift_is_fine(cell):
    cell.rest()
    cell.page.keyboard.press("g")
    point = points_of(cell, 3, ".seen")[6]
    box = cell.find("#view3d canvas").bounding_box()
    x, y = point + [box["x"], box["y"]]
    mouse = cell.page.mouse
    mouse.move(x, y)
    mouse.down()
    with cell.changing():
        mouse.move(x - 20, y - 12, steps=5)
        mouse.up()
    frame = data_of(cell)["path"]["frame"]
    angle = float(frame["rpy"][2].removesuffix(" deg"))
    assert angle != 0 and angle % 5 == 0
    # The middle of the rectangle stays, by the rotation of its frame.
    turned = rotation_by(math.radians(angle))
    position = np.array(millimetres(frame["position"])[:2])
    middle = position + turned @ [30, 15]
    np.testing.assert_allclose(middle, [40, 27], atol=1e-9)
    with cell.changing():
        grip(cell, 3).press("Shift+ArrowUp")
    finer = float(data_of(cell)["path"]["frame"]["rpy"][2].removesuffix(" deg"))
    assert finer == pytest.approx(angle + 0.1, abs=1e-9)


def test_typed_values_place_the_part_exactly(cell):
    cell.rest()
    cell.page.keyboard.press("g")
    box = cell.find(".place-box")
    for label, text, expected in (("X", "12.34", 12.34), ("Z", "1 in", 25.4)):
        with cell.changing():
            box.get_by_label(label).fill(text)
            box.get_by_label(label).press("Enter")
        position = millimetres(data_of(cell)["path"]["frame"]["position"])
        assert position["XYZ".index(label)] == pytest.approx(expected, abs=1e-12)
    with cell.changing():
        box.get_by_label("Angle").fill("30")
        box.get_by_label("Angle").press("Enter")
    # A typed angle is that of the frame, whose position stays as typed.
    frame = data_of(cell)["path"]["frame"]
    assert frame["rpy"][2] == "30 deg" and millimetres(frame["position"]) == [12.34, 12, 25.4]
    before = cell.text
    box.get_by_label("X").fill("far")
    box.get_by_label("X").press("Enter")
    expect(cell.find("#messages .dropped")).to_be_visible()
    assert cell.text == before


def test_part_out_of_reach_says_so_while_it_is_dragged(cell):
    cell.rest()
    cell.page.keyboard.press("g")
    with cell.changing():
        cell.find(".place-box").get_by_label("X").fill("330")
        cell.find(".place-box").get_by_label("X").press("Enter")
    # The keys are those of the page again.
    cell.page.keyboard.press("f")
    (ax, ay), (bx, by) = points_of(cell, 0, ".target")
    with cell.grabbing(grip(cell, 0)) as (x, y):
        for k in range(1, 12):
            cell.page.mouse.move(x + k * (bx - ax) / 3, y + k * (by - ay) / 3)
        cell.wait_for(".gizmo-figure[data-out=true]")
        cell.page.keyboard.press("Escape")
    cell.rest()
    assert millimetres(data_of(cell)["path"]["frame"]["position"])[0] == 330


def test_cylinder_is_added_moved_and_removed_and_another_kind_is_a_file(cell, folder):
    cell.rest()
    cell.page.keyboard.press("o")
    listed = cell.find(".obstacle-list")
    listed.get_by_role("button", name="+ Cylinder").click()
    dialog = cell.find("#question")
    dialog.get_by_label("Name").fill("can")
    dialog.get_by_label("Radius").fill("25")
    dialog.get_by_label("Length").fill("120")
    with cell.renewing():
        dialog.get_by_role("button", name="OK").click()
    (can,) = data_of(cell)["scene"]["obstacles"]
    assert (can["type"], can["name"], can["radius"], can["length"]) == (
        "cylinder", "can", "25 mm", "120 mm",
    )  # fmt: skip
    # It stands on the plane of the drawing, at a height of 200 mm of the base.
    assert millimetres(can["at"])[2] == 260
    # It is selected, in the list, in the drawing and in space.
    expect(listed.get_by_role("button", name="can cylinder")).to_have_attribute(
        "aria-pressed", "true"
    )
    expect(cell.find("g.handle.obstacle.selected")).to_have_count(1)
    cell.rest()
    with cell.renewing():
        cell.drag(grip(cell, 2), (0, -25))
    moved = data_of(cell)["scene"]["obstacles"][0]
    assert millimetres(moved["at"])[:2] == millimetres(can["at"])[:2]
    assert millimetres(moved["at"])[2] > 260 and millimetres(moved["at"])[2] % 5 == 0
    field = cell.find(".place-box").get_by_label("Radius")
    with cell.renewing():
        field.fill("30")
        field.press("Enter")
    assert data_of(cell)["scene"]["obstacles"][0]["radius"] == "30 mm"
    (folder / "tile.stl").write_text(STL)
    cell.find("#tool-box input[type=file]").set_input_files(folder / "tile.stl")
    with cell.renewing():
        dialog.get_by_role("button", name="OK").click()
    mesh = data_of(cell)["scene"]["obstacles"][1]
    assert (mesh["type"], mesh["name"], mesh["unit"]) == ("mesh", "tile", "mm")
    load_axe(cell.page)
    assert faults(cell.page) == []
    with cell.renewing():
        listed.get_by_role("button", name="Remove tile").click()
    with cell.renewing():
        listed.get_by_role("button", name="can cylinder").click()
        cell.page.keyboard.press("Delete")
    assert not data_of(cell).get("scene", {}).get("obstacles")
    expect(listed.locator("li")).to_have_count(0)


def test_obstacle_is_selected_by_a_click_in_space(page, folder):
    studio = shown(page, folder, JOB + POST, "post.yaml")
    studio.wait_for("#view3d[data-alarmed*=post], #figures[data-exact=true]")
    studio.page.keyboard.press("o")
    studio.find(".obstacle-list").get_by_role("button", name="ball sphere").click()
    expect(studio.find(".place-box")).to_have_attribute("data-target", "obstacle 1")
    # The origin of the gizmo is in the middle of the ball.
    x, y = origin_of(studio)
    studio.page.keyboard.press("Escape")
    expect(studio.find(".place-box")).to_be_hidden()
    studio.page.mouse.click(x, y)
    expect(studio.find(".place-box")).to_have_attribute("data-target", "obstacle 1")
    # A sphere has no angle.
    expect(grip(studio, 3)).to_be_hidden()


@pytest.fixture
def drawing(page, folder):
    """A page that shows a square and a circle."""
    (folder / "shapes.svg").write_text(DRAWING)
    text = JOB.replace(POINTS, "file: shapes.svg")
    return shown(page, folder, text, "drawing.yaml")


def on_screen(studio, point):
    """Where a point of the drawing is on the page [px]; the start of the first contour is known."""
    scale = float(studio.told("#view2d", "scale"))
    box = studio.find("#view2d").bounding_box()
    # The view is fitted: its middle is that of the drawing, beside the tools and above the legend.
    tools = studio.find("#viewbar .tools").bounding_box()
    legend = studio.find("#legend").bounding_box()
    left = tools["x"] + tools["width"] - box["x"]
    below = box["y"] + box["height"] - legend["y"]
    middle = np.array(
        [box["x"] + (box["width"] + left) / 2, box["y"] + (box["height"] - below) / 2]
    )
    # The shapes reach from 10 to 70 mm, and from 10 to 30 mm.
    return middle + scale * 1e-3 * (np.array(point) - [40, 20])


# Outline of two round marks.
TWO_MARKS = re.compile("^M[^ML]*M[^ML]*$")


def measured(studio, name):
    return float(studio.told(".measure-box", name))


def test_two_clicks_measure_a_distance_an_angle_and_a_radius(drawing):
    drawing.rest()
    drawing.page.keyboard.press("f")
    drawing.page.keyboard.press("m")
    mouse = drawing.page.mouse
    box = drawing.find(".measure-box")
    # On the circle, away from its start and end.
    on_circle = on_screen(drawing, [60 + 10 * math.cos(2.2), 20 + 10 * math.sin(2.2)])
    mouse.click(*on_circle)
    drawing.wait(".measure-box", kinds="circle")
    expect(box).to_contain_text("⌀ 20 mm")
    expect(box).to_contain_text("radius 10 mm")
    # The right side of the square: 30 mm from the centre of the circle.
    mouse.click(*on_screen(drawing, [30, 24]))
    drawing.wait(".measure-box", kinds="circle line")
    assert measured(drawing, "distance") == pytest.approx(0.03, abs=1e-9)
    expect(drawing.find("#view2d .measured-label")).to_be_visible()
    # Two points are marked, in the picture in space as well; no line looks like one of the path.
    for view in ("#view2d", "#view3d"):
        expect(drawing.find(f"{view} .measured-dots")).to_have_attribute("d", TWO_MARKS)
        paths = drawing.find(f"{view} .measured path:not(.measured-hover)")
        assert not any("L" in (x.get_attribute("d") or "") for x in paths.all())
    # Two sides of the square.
    mouse.click(*on_screen(drawing, [14, 10]))
    mouse.click(*on_screen(drawing, [30, 26]))
    drawing.wait(".measure-box", kinds="line line")
    assert measured(drawing, "angle") == pytest.approx(math.pi / 2, abs=1e-9)
    # A corner is a point; the diagonal of the square.
    mouse.click(*on_screen(drawing, [10, 10]))
    mouse.click(*on_screen(drawing, [30, 30]))
    drawing.wait(".measure-box", kinds="point point", picks="end of a line, end of a line")
    assert measured(drawing, "distance") == pytest.approx(0.02 * math.sqrt(2), abs=1e-9)
    expect(box).to_contain_text("28.28 mm")
    # Escape leaves the points first, then the tool.
    drawing.page.keyboard.press("Escape")
    drawing.wait(".measure-box", kinds="")
    drawing.page.keyboard.press("Escape")
    expect(box).to_be_hidden()


def test_only_a_centre_that_is_shown_is_measured(drawing):
    drawing.rest()
    drawing.page.keyboard.press("f")
    drawing.page.keyboard.press("m")
    drawing.wait_for(".measure-box")
    mark = drawing.find("#view2d .measured-hover")
    centre = on_screen(drawing, [60, 20])
    # At the pointer, the centre is shown with its circle.
    drawing.page.mouse.move(*centre, steps=3)
    drawing.wait(".measure-box", hovered="centre of a circle")
    expect(mark).to_have_attribute("d", re.compile("h16.*v16M.*L"))
    drawing.page.mouse.move(*on_screen(drawing, [45, 20]), steps=3)
    drawing.wait(".measure-box", hovered="")
    expect(mark).to_have_attribute("d", "")
    drawing.page.mouse.move(*centre, steps=3)
    drawing.wait(".measure-box", hovered="centre of a circle")
    drawing.page.mouse.down()
    drawing.page.mouse.up()
    drawing.wait(".measure-box", kinds="point", picks="centre of a circle")
    drawing.page.keyboard.press("Escape")
    drawing.wait(".measure-box", kinds="")
    # A finger shows nothing before its tap, so it takes no centre.
    drawing.page.mouse.move(*on_screen(drawing, [45, 20]))
    drawing.wait(".measure-box", hovered="")
    drawing.find("#view2d > svg").evaluate(TAP, list(centre))
    drawing.page.evaluate(TWO_FRAMES)
    drawing.wait(".measure-box", kinds="")
    drawing.page.keyboard.press("Escape")


def test_clicks_in_space_measure_obstacles(page, folder):
    studio = shown(page, folder, JOB + POST, "post.yaml")
    studio.wait_for("#view3d[data-alarmed*=post], #figures[data-exact=true]")
    studio.page.keyboard.press("o")
    studio.find(".obstacle-list").get_by_role("button", name="ball sphere").click()
    # The circles of the ball have their centre there.
    centre = origin_of(studio)
    studio.page.keyboard.press("m")
    expect(studio.find(".measure-box")).to_be_visible()
    studio.page.evaluate(TWO_FRAMES)
    studio.page.mouse.move(*centre, steps=4)
    studio.wait(".measure-box", hovered="centre of a circle")
    studio.page.mouse.down()
    studio.page.mouse.up()
    studio.wait(".measure-box", kinds="point", picks="centre of a circle")
    # In the work frame, the ball is at (-100, 450, 200) mm.
    text = studio.find(".measure-box").inner_text().replace("−", "-")
    assert [float(v) for v in re.findall(r"[xyz] (-?[\d.]+) mm", text)] == [-100, 450, 200]


def test_collision_is_posed_where_it_happens_and_one_pair_is_allowed(page, folder):
    studio = shown(page, folder, JOB + POST, "post.yaml")
    studio.wait("body", refused="true")
    contacts = studio.find(".contacts")
    rows = contacts.locator("li")
    expect(rows.first).to_be_visible()
    count = rows.count()
    first = rows.first.get_attribute("data-pair").split(",")
    studio.wait_for("#view3d:not([data-alarmed=''])")
    assert set(studio.told("#view3d", "alarmed").split(",")) == set(first)
    # The posture is the one of the contact, also after the time was moved away and back.
    posed = studio.told("#view3d", "joints")
    if studio.told("#playback", "time") != "0":
        studio.find("#playback .scrub").press("Home")
        studio.wait_for(f"#view3d:not([data-joints='{posed}'])")
    rows.first.get_by_role("button", name="Go there").click()
    studio.wait_for(f"#view3d[data-joints='{posed}']")
    expect(rows.first.get_by_role("button", name="Go there")).to_have_attribute(
        "aria-pressed", "true"
    )
    load_axe(studio.page)
    assert faults(studio.page) == []
    with studio.renewing():
        rows.first.get_by_role("button", name="Allow this pair").click()
    (link,) = data_of(studio)["scene"]["obstacles"][0]["allow"]
    assert {link, "post"} == set(first)
    # The other pairs are refused as before.
    pair = contacts.locator(f"[data-pair='{','.join(first)}']")
    expect(pair).to_have_count(0)
    expect(rows).not_to_have_count(0)
    with studio.renewing():
        studio.find("#undo").click()
    expect(rows).to_have_count(count)
    expect(pair).to_have_count(1)


def test_each_of_two_pairs_that_collide_at_the_same_time_is_shown_and_allowed(page, folder):
    studio = shown(page, folder, JOB + TWO_AT_START, "two.yaml")
    studio.wait("body", refused="true")
    rows = studio.find(".contacts li")
    second = rows.nth(1)
    expect(second).to_be_visible()
    times = [x.locator(".quiet").first.inner_text() for x in (rows.first, second)]
    assert times[0] == times[1]
    pair = second.get_attribute("data-pair").split(",")
    for row in (second, rows.first, second):
        row.get_by_role("button", name="Go there").click()
        expect(row.locator(".go")).to_have_attribute("aria-pressed", "true")
        expect(studio.find(".contacts .go[aria-pressed=true]")).to_have_count(1)
    studio.wait_for(f"#view3d[data-alarmed='{','.join(pair)}']")
    with studio.renewing():
        second.get_by_role("button", name="Allow this pair").click()
    allowed = [x for x in data_of(studio)["scene"]["obstacles"] if "allow" in x]
    assert [{x["name"], *x["allow"]} for x in allowed] == [set(pair)]
    with studio.renewing():
        studio.find("#undo").click()


def test_one_tool_at_a_time_and_views_by_keys(cell):
    cell.rest()
    keyboard = cell.page.keyboard
    tools = cell.find("#viewbar .tools")
    for key, name in (("g", "Move part"), ("m", "Measure"), ("o", "Obstacles"), ("v", "Select")):
        keyboard.press(key)
        pressed = tools.locator("[aria-pressed=true]")
        expect(pressed).to_have_count(1)
        expect(pressed).to_have_attribute("aria-label", name)
    for number, name in enumerate(("Part", "Cell", "Top", "Front", "Side"), start=1):
        keyboard.press(str(number))
        view = cell.find(f".arm-bar [data-view='{name}']")
        expect(view).to_have_attribute("aria-pressed", "true")
    # Escape leaves the selected contour first, then the tool.
    cell.find("ol.contours li button:not(.move)").first.click()
    keyboard.press("m")
    keyboard.press("Escape")
    expect(tools.get_by_role("button", name="Measure")).to_have_attribute("aria-pressed", "true")
    keyboard.press("Escape")
    expect(tools.get_by_role("button", name="Select")).to_have_attribute("aria-pressed", "true")


def test_fit_shows_obstacles_as_well(page, folder):
    studio = shown(page, folder, JOB + POST, "post.yaml")
    studio.wait_for("g.handle.obstacle")
    region = studio.find("#view2d").bounding_box()
    studio.page.keyboard.press("f")
    studio.page.wait_for_timeout(200)
    for shape in studio.find("g.handle.obstacle .seen").all():
        box = shape.bounding_box()
        assert box["x"] >= region["x"] and box["y"] >= region["y"]
        assert box["x"] + box["width"] <= region["x"] + region["width"]
        assert box["y"] + box["height"] <= region["y"] + region["height"]


def test_marks_of_many_corners_do_not_cover_each_other(page, folder):
    """A ring of 90 corners, of which zooming in shows more."""
    angles = [2 * math.pi * k / 90 for k in range(91)]
    points = [[0.03 * math.cos(a), 0.03 * math.sin(a), 0] for a in angles]
    text = JOB.replace(POINTS, f"points: {points}").replace("1 mm}", "0.1 mm}")
    studio = shown(page, folder, text, "ring.yaml")
    studio.rest()
    marks = studio.find("g.handle.corner:not([hidden])")
    places = [studio.middle(x.locator(".seen")) for x in marks.all()]
    assert len(places) > 10
    for k, (x, y) in enumerate(places):
        assert all(math.hypot(x - u, y - v) > 23 for u, v in places[:k])
    # Zooming in shows more of them.
    for _ in range(4):
        studio.find("#viewbar").get_by_role("button", name="Zoom in").click()
    studio.page.wait_for_timeout(300)
    assert marks.count() > len(places)


def test_fit_leaves_out_a_plate_on_the_part_that_is_not_drawn(page, folder):
    plate = """\
scene:
  obstacles:
    - {type: box, name: plate, size: [300 mm, 300 mm, 5 mm], at: [0, 0, -20 mm], fixed_to: part}
"""
    studio = shown(page, folder, JOB + plate, "plate.yaml")
    studio.rest()
    before = float(studio.told("#view2d", "scale"))
    studio.page.keyboard.press("f")
    studio.page.wait_for_timeout(200)
    assert float(studio.told("#view2d", "scale")) == pytest.approx(before, rel=0.01)


@pytest.mark.parametrize("width", [75, 400])
def test_contour_over_an_obstacle_is_selected_first(drawing, folder, width):
    """The obstacle is below the circle, or below all contours."""
    middle = 445 + width / 2 if width < 100 else 440
    below = f"""\
scene:
  obstacles:
    - type: box
      name: table
      size: [{width} mm, 400 mm, 20 mm]
      at: [{middle} mm, -20 mm, 100 mm]
"""
    text = JOB.replace(POINTS, "file: shapes.svg") + below
    studio = shown(drawing, folder, text, "table.yaml")
    studio.wait_for("g.handle.obstacle")
    studio.rest()
    box = studio.find(".place-box")
    chosen = studio.find("ol.contours [aria-pressed=true]")
    studio.page.mouse.click(*on_screen(studio, [50, 20]))
    expect(chosen).to_have_count(1)
    expect(box).to_be_hidden()
    studio.page.mouse.click(*on_screen(studio, [60, 20]))
    expect(chosen).to_have_count(0)
    # An obstacle around the whole part is its ground.
    if width > 100:
        expect(box).to_be_hidden()
        studio.page.keyboard.press("o")
        studio.page.mouse.click(*on_screen(studio, [60, 20]))
    expect(box).to_have_attribute("data-target", "obstacle 0")
    studio.page.keyboard.press("Escape")
    studio.page.keyboard.press("Escape")


def test_tools_of_narrow_pages_fit_and_have_large_targets(pages, server):
    studio = pages(size=(390, 844))
    studio.begin()
    studio.wait_for("#view2d[data-duration]:not([data-duration=''])")
    studio.find("#viewbar").get_by_role("button", name="3D").click()
    boxes = {"Move part": ".place-box", "Obstacles": ".obstacle-list", "Measure": ".measure-box"}
    for name, selector in boxes.items():
        studio.find("#viewbar").get_by_role("button", name=name).click()
        expect(studio.find(selector)).to_be_visible()
        box = studio.find(selector).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 390
        # The view is above the box, and shows the whole gizmo.
        view = studio.find("#view3d").bounding_box()
        assert view["y"] + view["height"] <= box["y"] + 1
        assert name != "Move part" or view["height"] > 150
        for shape in studio.find(".gizmo-grip .seen").all():
            if shape.is_visible():
                seen = shape.bounding_box()
                assert seen["y"] >= view["y"]
                assert seen["y"] + seen["height"] <= view["y"] + view["height"]
        for control in studio.find("#tool-box").locator("button, input").all():
            if control.is_visible():
                assert control.bounding_box()["height"] >= 44
