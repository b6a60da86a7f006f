"""Report of a batch, origin of pages, and the still picture of the arm."""

import hashlib
import re
from importlib import resources

import numpy as np
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.core.result import Data, Row
from armcontour.files import parse_job
from armcontour.report import render_report
from armcontour.report.arm_frame import arm_frame
from armcontour.report.batch_report import BatchEntry, render_batch
from armcontour.report.origin import Origin
from armcontour.report.still_arm import draw_still

POINTS = "path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}"
# Direction of the still picture: azimuth and elevation [rad].
AZIMUTH = -0.7
ELEVATION = 0.45


def entry(name, kept, error, duration):
    rows = (
        Row("kept", kept, "verdict", "verdict"),
        Row("off_drawing", error, "m", "off the drawing"),
        Row("duration", duration, "s", "motion"),
    )
    return BatchEntry(name=name, values=f"speed {name}", data=Data("", rows))


def test_points_of_a_batch_are_at_time_and_error_and_lead_to_their_run():
    entries = [entry("1", True, 1e-4, 4.0), entry("2", False, 3e-4, 2.0)]
    entries.append(BatchEntry(name="3", values="speed 3", data=Data(""), error="Out of reach."))
    rows = [("1", "kept"), ("2", "NOT KEPT"), ("3", "refused")]
    page = render_batch("Batch", "", ("job", "limits.speed"), rows, entries, Origin(job="a"))
    circle = re.search(r'<circle class="run kept" cx="([\d.]+)" cy="([\d.]+)"', page)
    cross = re.search(r'<path class="run not-kept" d="M([\d.]+) ([\d.]+)m', page)
    kept, not_kept = (tuple(map(float, x.groups())) for x in (circle, cross))
    # The error grows to the right, the time upwards; SVG's y points down.
    assert kept[0] < not_kept[0] and kept[1] < not_kept[1]
    for number, _ in rows:
        assert f'<details id="job-{number}">' in page
    assert re.findall(r'<a href="#job-(\d)" aria-label', page) == ["1", "2"]
    assert re.findall(r'<th scope="row"><a href="#job-(\d)">', page) == ["1", "2", "3"]
    assert '<td class="not-kept">NOT KEPT</td>' in page
    assert "1 of 2 runs are kept" in page and "speed (limits)" in page
    assert "Out of reach." in page


def test_a_page_names_its_job_its_files_with_their_checksums_and_its_date(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1767225600")
    drawing = tmp_path / "line.csv"
    drawing.write_text("x [m],y [m]\n0.3,0.2\n0.33,0.2\n")
    file = tmp_path / "job.yaml"
    file.write_text(CORNER_JOB.replace(POINTS, "path: {file: line.csv}"))
    job = ac.read_job(file, patch={("limits", "speed"): "0.02 m/s"})
    page = render_report(ac.run(job, simulate=False))
    for source in (file, drawing):
        digits = hashlib.sha256(source.read_bytes()).hexdigest()[:12]
        assert re.search(rf"{source.name} <code[^>]*>{digits}</code>", page)
    assert "changed limits.speed" in page
    assert f"Job {job.name} ·" in page
    assert '<time datetime="2026-01-01T00:00:00+00:00">' in page


def test_files_of_the_package_are_no_sources_of_a_job(tmp_path):
    text = (resources.files("armcontour.jobs") / "library" / "paper.yaml").read_text("utf-8")
    file = tmp_path / "paper.yaml"
    file.write_text(text)
    assert [x.name for x in ac.read_job(file).sources] == ["paper.yaml"]
    part = tmp_path / "part.csv"
    part.write_text("x [m],y [m]\n0.3,0.2\n0.33,0.2\n")
    job = ac.read_job(part, cell="pmk3s")
    assert [x.name for x in job.sources] == ["the cell pmk3s", "part.csv"]


def test_the_still_arm_shows_the_path_where_an_own_projection_has_it():
    job = parse_job(CORNER_JOB)
    points = np.array([[0.30, 0.20, 0.0], [0.36, 0.20, 0.0], [0.36, 0.24, 0.0]])
    svg = draw_still(arm_frame(job), np.array([0.2, 0.9]), [("#123456", points)])
    numbers = re.search(r'd="M([^"]+)" fill="none" stroke="#123456"', svg)[1].split()
    drawn = np.array(numbers, float).reshape(-1, 2)
    # The base is the origin of the path: project on axes to the right and up.
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    up = np.array([
        -np.sin(ELEVATION) * np.cos(AZIMUTH),
        -np.sin(ELEVATION) * np.sin(AZIMUTH),
        np.cos(ELEVATION),
    ])  # fmt: skip
    expected = np.column_stack([points @ right, -(points @ up)])
    steps = np.diff(drawn, axis=0)
    expected_steps = np.diff(expected, axis=0)
    scale = np.linalg.norm(steps) / np.linalg.norm(expected_steps)
    np.testing.assert_allclose(steps, scale * expected_steps, atol=0.2)
    # Another posture gives another picture of the arm, and the same path.
    other = draw_still(arm_frame(job), np.array([1.2, 0.3]), [("#123456", points)])
    assert other != svg
    x, y, width, height = map(float, re.search(r'viewBox="([^"]+)"', svg)[1].split())
    corners = np.array(re.findall(r"(-?\d+) (-?\d+)(?=[ z])", svg), float)
    assert (corners >= [x, y]).all() and (corners <= [width, height]).all()
