"""Journeys of users in the Studio in a real browser; values are those of the library."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.test_journeys import press
from tools.studio_page import serving, write_job

pytestmark = pytest.mark.browser
DRAWINGS = Path(__file__).parents[3] / "examples" / "drawings"
EXACT = 1e-9


def test_a_saved_job_runs_on_the_command_line_with_the_same_figures(pages, tmp_path):
    file = write_job(tmp_path / "job.yaml", "optimal")
    original = file.read_bytes()
    with serving(file, folder=tmp_path) as server:
        studio = pages(server)
        studio.rest()
        studio.page.keyboard.press("Control+s")
        expect(studio.find("#messages")).to_contain_text("Saved")
        assert file.read_bytes() == original, "nothing was changed, and nothing is written anew"
        with studio.changing():
            studio.drag(studio.handle("waypoint", 1), (14, -9))
        studio.page.keyboard.press("Control+s")
        studio.wait("body", dirty="false")
        assert file.read_text() == studio.text
        command = ["run", str(file), "--out", str(tmp_path / "out")]
        subprocess.run([sys.executable, "-m", "armcontour", *command], check=True, timeout=120)
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        written = summary["runs"]["optimal"]
        assert studio.figure("duration") == pytest.approx(written["duration"], abs=EXACT)
        rms = written["contour_error"]["rms"]
        assert studio.figure("contour_error.rms") == pytest.approx(rms, abs=EXACT)
        # Another program changes the file: both versions remain available.
        file.write_bytes(original)
        studio.tab("process")
        with studio.changing():
            studio.type("limits.speed", "0.12 m/s")
        studio.page.keyboard.press("Control+s")
        dialog = studio.find("#question")
        expect(dialog).to_contain_text("changed")
        assert file.read_bytes() == original
        with studio.changing():
            dialog.get_by_role("button", name="Take the file's").click()
        assert studio.text.encode() == original


def test_a_dropped_drawing_is_played(pages, judge):
    studio = pages()
    studio.rest()
    content = (DRAWINGS / "gasket.dxf").read_text()
    data = studio.page.evaluate_handle(
        """(text) => {
            const data = new DataTransfer();
            data.items.add(new File([text], "gasket.dxf"));
            return data;
        }""",
        content,
    )
    with studio.changing():
        for event in ("dragover", "drop"):
            studio.page.dispatch_event("main", event, {"dataTransfer": data})
        dialog = studio.find("#question")
        dialog.locator("select").select_option("ur5e")
        dialog.get_by_role("button", name="Open").click()
    run = studio.find("#run").input_value()
    first = studio.figure("duration")
    assert first == pytest.approx(judge(studio, run).trajectory.duration, abs=EXACT)
    press(studio, "#viewbar", "Both")
    press(studio, "#playback", "Play")
    studio.wait("#playback", state="playing")
    time.sleep(0.3)
    press(studio, "#playback", "Pause")
    t = float(studio.told("#playback", "time"))
    assert t > 0
    studio.wait("#view3d", time=studio.told("#playback", "time"))
    joints = [float(x) for x in studio.told("#view3d", "joints").split(",")]
    planned = judge(studio, run).trajectory(t)
    np.testing.assert_allclose(joints, planned, atol=1e-4)


def test_a_draft_survives_closing_the_page_and_the_server(pages, tmp_path):
    file = write_job(tmp_path / "job.yaml", "optimal")
    with serving(file, folder=tmp_path) as server:
        studio = pages(server)
        studio.rest()
        studio.tab("process")
        with studio.changing():
            studio.type("limits.speed", "0.1 m/s")
        changed = studio.text
        shown = studio.figure("duration")
        time.sleep(0.5)
        studio.is_cut_off = True
        server.process.kill()
        server.process.wait()
        studio.wait("body", link="lost", stopped="true")
        assert studio.figure("duration") == shown
        # No figure is marked as exact, and nothing can be changed that would be lost.
        studio.wait("#figures", exact="false")
        expect(studio.find(".exactness")).to_have_text("not connected")
        expect(studio.find("#messages")).to_contain_text("nothing can be changed")
        expect(studio.find("#panel")).to_have_attribute("inert", "")
        # The page says what is kept, with the last change, and how to go on.
        message = studio.find("#messages .stopped")
        expect(message).to_contain_text("0.1 m/s")
        expect(message.locator("code")).to_have_text(f"armcontour studio {file}")
        name, content = studio.save_file(message.get_by_role("button", name="Save a copy"))
        assert name.endswith(".yaml") and content.decode() == changed
        # A server that has ended does not come back at this address.
        studio.wait("body", link="refused", stopped="true")
        expect(message).to_be_visible()
    with serving("--port", str(server.port), file, folder=tmp_path) as again:
        fresh = pages(again)
        fresh.wait("body", link="open")
        press(fresh, "#question", "Take them up")
        fresh.wait("body", dirty="true")
        fresh.rest()
        assert fresh.text == changed
        assert fresh.figure("duration") == shown
        # The new address may be pasted into the old page.
        studio.page.evaluate("x => { location.hash = x; }", again.address.partition("#")[2])
        studio.wait("body", link="open")
        studio.rest()
        assert studio.figure("duration") == shown
        expect(studio.find("#panel")).not_to_have_attribute("inert", "")
        expect(message).to_have_count(0)
        assert studio.page.evaluate("location.hash") == ""


def test_a_job_refused_when_it_is_opened_is_shown_at_its_line(pages, tmp_path):
    job = write_job(tmp_path / "job.yaml", "optimal", changes=[("  speed:", "  sped:")])
    line = next(k for k, x in enumerate(job.read_text().splitlines(), 1) if "sped:" in x)
    with serving(job, folder=tmp_path) as server:
        studio = pages(server)
        studio.begin()
        area = studio.find("#tab-text textarea")
        expect(area).to_be_focused()
        expect(studio.find("#tab-text [role=status]")).to_contain_text(f"Line {line}: ")
        chosen = "e => e.value.slice(e.selectionStart, e.selectionEnd)"
        assert "sped:" in area.evaluate(chosen)
