"""A log of the robot that is dropped on the page: compared, identified, learned from."""

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.studio.robot_logs import HEAD, TRUE, write_table

import armcontour as ac
from armcontour.cli import main
from armcontour.core.render import number
from armcontour.files import parse_job
from armcontour.files.log_file import read_log

pytestmark = pytest.mark.browser
DROP = """async ([name, bytes]) => {
  const data = new DataTransfer();
  data.items.add(new File([new Uint8Array(bytes)], name));
  const options = { dataTransfer: data, bubbles: true, cancelable: true };
  for (const kind of ["dragover", "drop"])
    document.body.dispatchEvent(new DragEvent(kind, options));
}"""


@pytest.fixture
def shown(pages, robot):
    """A page that shows the job of the robot."""
    studio = pages()
    studio.begin()
    studio.open(robot.file)
    studio.rest()
    return studio


def drop(studio, log):
    """Drop a log on the page, which keeps and ticks it."""
    studio.page.evaluate(DROP, [log.name, list(log.read_bytes())])
    expect(studio.find("section.logs").get_by_label(log.name)).to_be_checked()


def done(studio, task):
    """Do a task with the logs that are ticked."""
    result = studio.do(task)
    expect(result.locator(".task-progress")).to_have_count(0)
    return result


def cell(result, name):
    """The figure of a name."""
    return result.locator(
        "tr", has=result.page.locator("th[scope=row]", has_text=name)
    ).first.locator("td")


def test_j41_a_log_gives_the_servo_of_the_job(shown, log):
    before = shown.text
    drop(shown, log)
    result = done(shown, "identify")
    expect(result).to_have_attribute("data-state", "done")
    identification = ac.identify(read_log(log), ac.ServoFit(kinematics=ac.load_arm("pmk3s")))
    kp = cell(result, "joint 1").nth(0)
    table = result.locator("table", has_text="kp")
    expect(table).to_contain_text(number(identification["joint 1"].kp.value, "1/s"))
    expect(kp).to_be_visible()
    load_axe(shown.page)
    assert faults(shown.page) == []
    with shown.changing():
        result.get_by_role("button", name="Use this servo").click()
    servo = parse_job(shown.text).servo
    np.testing.assert_allclose(servo.kp, TRUE.kp, rtol=0.01)
    np.testing.assert_allclose(servo.kv, TRUE.kv, rtol=0.01)
    with shown.changing():
        shown.find("#undo").click()
    assert shown.text == before


def test_j42_the_next_set_points_are_those_of_learn(shown, robot, log, monkeypatch):
    drop(shown, log)
    result = done(shown, "learn")
    expect(result).to_have_attribute("data-state", "done")
    button = result.get_by_role("button", name="Download next set-points")
    _, content = shown.save_file(button)
    first, second = robot.folder / "first", robot.folder / "second"
    for arguments in (
        ("run", robot.file, "--out", first, "--no-simulation"),
        ("learn", robot.file, "--set-points", first, "--log", log, "--out", second),
    ):
        monkeypatch.setattr("sys.argv", ["armcontour", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code
    assert content == (second / "optimal/set_points.csv").read_bytes()


def test_j43_errors_of_a_log_are_shown_as_text(shown, robot):
    markup = "<img src=x onerror=alert(1)>"
    bad = write_table(
        robot.folder / f"{markup}.csv", robot.table(robot.execute())[:, :4], HEAD[:-17]
    )
    drop(shown, bad)
    result = done(shown, "learn")
    expect(result).to_have_attribute("data-state", "failed")
    # The second joint has no partner.
    expect(result.locator(".task-sentence")).to_contain_text(f"{markup}.csv has 1 joint")
    expect(shown.find("section.logs")).to_contain_text(markup)
    assert shown.find("#tasks img").count() == 0
    broken = robot.folder / "broken.csv"
    broken.write_bytes(b"t,q1\n" + bytes(range(256)))
    drop(shown, broken)
    result = done(shown, "learn")
    expect(result.locator(".task-sentence")).to_contain_text("broken.csv cannot be read")
    # Waypoints are no log.
    points = robot.folder / "points.csv"
    points.write_text("x,y\n0.35,0.1\n0.41,0.15\n0.28,0.3\n")
    shown.page.evaluate(DROP, [points.name, list(points.read_bytes())])
    dialog = shown.find("#question")
    expect(dialog).to_contain_text("Cell")
    dialog.get_by_role("button", name="Cancel").click()
