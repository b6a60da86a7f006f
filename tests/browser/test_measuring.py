"""Touched points typed and pasted on the page: residuals, dots in the pictures, and the frame."""

import pytest
from playwright.sync_api import expect
from tests.cli.test_measuring import JOB
from tests.studio.test_measuring import touched

pytestmark = pytest.mark.browser
# Pastes a text into a cell.
PASTE = """([label, text]) => {
  const data = new DataTransfer();
  data.setData("text", text);
  const options = { clipboardData: data, bubbles: true, cancelable: true };
  const cell = document.querySelector(`[aria-label="${label}"]`);
  cell.dispatchEvent(new ClipboardEvent("paste", options));
}"""


@pytest.fixture
def shown(pages, tmp_path):
    """A page that shows a part on a table."""
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    studio = pages()
    studio.begin()
    studio.open(file)
    studio.wait("#view2d", stale="false")
    studio.tab("tasks")
    return studio


def test_pasted_touches_move_the_part_and_undo_moves_it_back(shown):
    rows = touched()
    titles = "\t".join(["x", "y", "z", *(f"q{k}" for k in range(1, 7))])
    table = "\n".join([titles, *("\t".join(row) for row in rows[:3])])
    shown.page.evaluate(PASTE, ["Touch 1, x [mm]", table])
    shown.find("#tasks").get_by_role("button", name="Add a touch").click()
    fields = shown.find(".touch-table tbody tr").nth(3).locator("input")
    for k, text in enumerate(rows[3]):
        fields.nth(k).fill(text)
    result = shown.do("measure")
    expect(result).to_have_attribute("data-state", "done")
    expect(result.locator("tbody tr")).to_have_count(4)
    expect(result).to_contain_text("Expected error", ignore_case=True)
    expect(shown.find("g.touched circle")).to_have_count(4)
    before = shown.text
    result.get_by_role("button", name="Use this frame").click()
    shown.wait_for("#undo:not([disabled])")
    assert "rpy: [0, 0, 10 deg]" in before and "rpy: [0, 0, 10 deg]" not in shown.text
    expect(result).to_have_attribute("data-outdated", "false")
    shown.find("#undo").click()
    expect(shown.find("#undo")).to_be_disabled()
    assert shown.text == before


def test_a_refused_measurement_shows_its_sentence_and_keeps_the_job(shown):
    rows = touched()
    table = "\n".join("\t".join(row) for row in [rows[1], rows[1], rows[1]])
    shown.page.evaluate(PASTE, ["Touch 1, x [mm]", table])
    result = shown.do("measure")
    expect(result).to_have_attribute("data-state", "failed")
    expect(result.locator(".task-sentence")).to_contain_text("at one place")
    expect(shown.find("#undo")).to_be_disabled()
    expect(shown.find("g.touched circle")).to_have_count(0)


def test_a_doubt_is_accepted_by_its_name(shown):
    rows = [[x, f"-{y}", *more] for x, y, *more in touched()]
    table = "\n".join("\t".join(row) for row in rows)
    shown.page.evaluate(PASTE, ["Touch 1, x [mm]", table])
    result = shown.do("measure")
    expect(result.locator(".task-sentence")).to_contain_text("turned_over")
    shown.find("#tasks").get_by_label("accept the doubt").select_option("turned_over")
    result = shown.do("measure")
    expect(result).to_have_attribute("data-state", "done")
    expect(result).to_contain_text("From the plan", ignore_case=True)
    expect(result).to_contain_text("No redundancy for", ignore_case=True)
