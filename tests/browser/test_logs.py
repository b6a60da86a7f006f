"""Robot logs dropped on the page: learning from them, and refusals."""

import pytest
from playwright.sync_api import expect
from tests.studio.robot_logs import write_table

pytestmark = pytest.mark.browser
# A log whose second joint has a command but no measured position.
HEAD_OF_INCOMPLETE_LOG = "t [s],command 1 [rad],command 2 [rad],measured 1 [rad]"
# A name that would run a script if the page inserted it as HTML.
MARKUP = "<img src=x onerror=alert(1)>"
# Drops a file with a name and bytes on the page.
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


def drop_file(studio, file):
    """Drop a file on the page."""
    studio.page.evaluate(DROP, [file.name, list(file.read_bytes())])


def drop_log(studio, log):
    """Drop a log on the page, which lists and selects it."""
    drop_file(studio, log)
    expect(studio.find("section.logs").get_by_label(log.name)).to_be_checked()


def learn_from_selected_logs(studio):
    """Learn from the selected logs, and return the result on the page when learning has ended."""
    result = studio.do("learn")
    expect(result.locator(".task-progress")).to_have_count(0)
    return result


def test_the_studio_learns_the_next_set_points_from_a_log(shown, log):
    drop_log(shown, log)
    result = learn_from_selected_logs(shown)
    expect(result).to_have_attribute("data-state", "done")
    button = result.get_by_role("button", name="Download next set-points")
    name, content = shown.save_file(button)
    assert name.endswith("set_points.csv") and content.startswith(b"t [s],")


def test_markup_in_the_name_of_an_invalid_log_is_shown_as_text(shown, robot):
    rows = robot.table(robot.execute())[:, :4]
    log = write_table(robot.folder / f"{MARKUP}.csv", rows, HEAD_OF_INCOMPLETE_LOG)
    drop_log(shown, log)
    result = learn_from_selected_logs(shown)
    expect(result).to_have_attribute("data-state", "failed")
    expect(result.locator(".task-sentence")).to_contain_text(f"{MARKUP}.csv has 1 joint")
    expect(shown.find("section.logs")).to_contain_text(MARKUP)
    assert shown.find("#tasks img").count() == 0


def test_a_log_that_is_not_text_is_refused(shown, robot):
    log = robot.folder / "broken.csv"
    log.write_bytes(b"t,q1\n" + bytes(range(256)))
    drop_log(shown, log)
    result = learn_from_selected_logs(shown)
    expect(result.locator(".task-sentence")).to_contain_text("broken.csv cannot be read")


def test_a_dropped_table_of_waypoints_is_a_drawing_and_not_a_log(shown, robot):
    waypoints = robot.folder / "points.csv"
    waypoints.write_text("x,y\n0.35,0.1\n0.41,0.15\n0.28,0.3\n")
    drop_file(shown, waypoints)
    dialog = shown.find("#question")
    expect(dialog).to_contain_text("Cell")
    dialog.get_by_role("button", name="Cancel").click()


def test_several_logs_are_added_at_once_and_all_are_used(shown, robot):
    files = [robot.folder / f"{name}.csv" for name in ("first", "second", "third")]
    for k, file in enumerate(files):
        robot.log(file, seed=k)
    logs = shown.find("section.logs")
    shown.tab("tasks")
    with shown.page.expect_file_chooser() as choosing:
        logs.locator(".task-head button").click()
    assert choosing.value.is_multiple()
    choosing.value.set_files(files[:2])
    for file in files[:2]:
        expect(logs.get_by_label(file.name)).to_be_checked()
    # Another one leaves the first ones ticked.
    drop_log(shown, files[2])
    for file in files:
        expect(logs.get_by_label(file.name)).to_be_checked()
    # A task uses those that are ticked.
    result = shown.do("identify")
    expect(result.locator(".task-progress")).to_have_count(0)
    expect(result).to_have_attribute("data-state", "done")
    expect(result.locator(".task-sentence, .tiles").first).to_be_visible()
