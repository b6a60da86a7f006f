"""Robot logs dropped on the page: learning from them, and refusals."""

import pytest
from playwright.sync_api import expect
from tests.studio.robot_logs import HEAD, write_table

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
    studio.wait("#view2d", stale="false")
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


def test_the_studio_learns_the_next_set_points_from_a_log(shown, log):
    drop(shown, log)
    result = done(shown, "learn")
    expect(result).to_have_attribute("data-state", "done")
    button = result.get_by_role("button", name="Download next set-points")
    name, content = shown.save_file(button)
    assert name.endswith("set_points.csv") and content.startswith(b"t [s],")


def test_errors_in_a_log_are_shown_as_text(shown, robot):
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
