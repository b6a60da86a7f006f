"""Cells with external axes on the page and in reports."""

import pytest
from playwright.sync_api import expect
from tests.report.drawn_bodies import Drawing, in_picture

import armcontour as ac
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.report.arm_frame import arm_frame
from armcontour.report.moving_arm import draw_arm

pytestmark = pytest.mark.browser
CELL = """
name: cell
arm:
  name: ur10e
  rail: {axis: [0, 1, 0], lower: -500 mm, upper: 2.5, velocity: 1, acceleration: 1}
  positioner:
    axes:
      - {name: turn, axis: [0, 0, 1], origin: [0.9, 0, 0.4], lower: -90 deg, upper: 90 deg,
         velocity: 1, acceleration: 2}
path:
  points: [[-0.1, 0, 0.05], [0.1, 0, 0.05], [0.1, 0.1, 0.05]]
  frame: {position: [0.9, 0, 0.4]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 50 mm/s}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
cycle: 8 ms
runs: {cut: {}}
"""
# Wide and narrow screens.
SIZES = [(1440, 900), (390, 844)]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    made = tmp_path_factory.mktemp("cells") / "cell.yaml"
    made.write_text(CELL)
    return made


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page of the moving arm, its bodies, and its first posture."""
    job = parse_job(CELL)
    result = ac.run(job).runs["cut"]
    page = tmp_path_factory.mktemp("report") / "arm.html"
    draw_arm(result, job).write_html(page)
    return page, Drawing(arm_frame(job)), result.trajectory(0.0), job


@pytest.mark.parametrize("size", SIZES)
def test_a_report_shows_the_whole_cell(browser, report, size):
    file, drawing, q, job = report
    page = browser.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
    page.goto(file.as_uri())
    space = page.wait_for_selector(".space[data-camera]", timeout=120_000)
    camera = [float(x) for x in space.get_attribute("data-camera").split(",")]
    expect(page.locator(".told")).to_contain_text("rail")
    assert in_picture(drawing, q, job.program, camera) > 0.85
    page.close()


@pytest.mark.parametrize("size", SIZES)
def test_the_page_shows_the_whole_cell(pages, file, report, size):
    _, drawing, _, job = report
    studio = pages(size=size)
    studio.begin()
    studio.open(file)
    studio.find("[data-stage='3d'], button:has-text('3D')").first.click()
    studio.rest()
    studio.wait_for(".arm-box[data-camera]")
    q = [float(x) for x in studio.told("#view3d", "joints").split(",")]
    camera = [float(x) for x in studio.told(".arm-box", "camera").split(",")]
    assert in_picture(drawing, q, job.program, camera) > 0.6


def test_keys_of_external_axes_have_the_units_of_the_page(pages, file):
    studio = pages()
    studio.begin()
    studio.open(file)
    studio.tab("robot")
    keys = ("arm.rail", "arm.positioner", "arm.positioner.axes", "arm.positioner.axes.0")
    for attribute in ("[data-group='Arm and limits']", *(f"[data-key='{x}']" for x in keys)):
        part = studio.find(f"#panel details{attribute}")
        if part.get_attribute("open") is None:
            part.locator("summary").first.click()
    shown = {"arm.rail.upper": "2500 mm", "arm.positioner.axes.0.upper": "90 deg"}
    for key, text in shown.items():
        expect(studio.slider(key).locator("input")).to_have_value(text)
    origin = studio.slider("arm.positioner.axes.0.origin")
    expect(origin.locator("input")).to_have_value("900, 0, 400")
    expect(origin.locator(".from")).to_have_text("mm")
    with studio.renewing():
        studio.type("arm.rail.upper", "2600")
    with studio.renewing():
        studio.type("arm.rail.lower", "-600")
    rail = load(studio.text, "")["arm"]["rail"]
    assert (rail["upper"], rail["lower"]) == (2.6, "-600 mm")
    expect(studio.slider("arm.rail.upper").locator("input")).to_have_value("2600 mm")
    velocity = studio.slider("limits.joint_velocity.1")
    expect(velocity.locator("label")).to_have_text("Joint velocity, rail")
    expect(velocity.locator("input[type=text]")).to_have_value("1000 mm/s")
    # Examples of revolute joints are not those of the rail.
    hints = studio.page.evaluate(
        """() => [...document.querySelectorAll("#panel .setting")]
            .filter(x => x.querySelector("label").textContent.endsWith(", rail"))
            .map(x => x.querySelector("input[type=text]")?.placeholder ?? "")"""
    )
    assert hints and not [x for x in hints if "rad" in x or "deg" in x]
    with studio.renewing():
        studio.type("limits.joint_velocity.1", "900")
    assert load(studio.text, "")["limits"]["joint_velocity"][1] == 0.9
    expect(velocity.locator("input[type=text]")).to_have_value("900 mm/s")
