"""Drawings as waypoints of the job."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armcontour._yaml import load
from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.io.job_edits import change_text
from armcontour.jobs import Job
from armcontour.studio.edits import EditState, changes_of
from armcontour.studio.handles import handles_of

SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="90mm" viewBox="0 0 90 90">'
    "{}</svg>"
)
LINES = '<path d="M0 0 L60 0 L60.3 40.7"/>'
# Tangent arcs of less and of more than three quarters of a turn.
ARCS = '<path d="M10 20 L40 20 A10 10 0 0 1 40 40 A3 3 0 1 0 43 43 L10 47 A4 9 0 0 1 5 20"/>'
CIRCLE = '<circle cx="30" cy="40" r="20"/>'
JOB = """\
# Kept.
name: a
arm: {arm}
path: {path}   # of the drawing
limits: {{speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}}
servo: {{kp: 25 1/s, kv: 150 1/s}}
runs: {{own: {{}}}}
"""
PLANE = "{file: a.svg, scale: 0.5, frame: {position: [280 mm, 0.2, 0], rpy: [0, 0, 20 deg]}%s}"
SPACE = (
    "{file: a.svg, names: null, frame: {position: [0.4, -0.1, 0.2], rpy: [10 deg, 0.2, 20 deg]}, "
    "orientation: {axis: [0, 0, -1]}%s}"
)


def converted(
    folder: Path, drawing: str, path: str, arm: str = "pmk3s", more: str = ""
) -> tuple[Job, Job, dict]:
    """The job before and after, and the data of the path."""
    (folder / "a.svg").write_text(SVG.format(drawing))
    text = JOB.format(arm=arm, path=path % "") + more
    job = parse_job(text, folder=folder)
    data = load(text, "")
    state = EditState(data=data, run="own", handles=handles_of(job, data))
    new = change_text(text, changes_of({"do": "to_waypoints"}, state))
    assert new.startswith("# Kept.\n")
    return job, parse_job(new), load(new, "")["path"]


@pytest.mark.parametrize("drawing", [LINES, ARCS, CIRCLE])
@pytest.mark.parametrize(("path", "arm"), [(PLANE, "pmk3s"), (SPACE, "ur5e")])
def test_lines_stay_lines_and_arcs_stay_arcs(tmp_path, drawing, path, arm) -> None:
    before, after, written = converted(tmp_path, drawing, path, arm)
    one, other = before.program.path, after.program.path
    assert len(one) == len(other)
    np.testing.assert_allclose(other.curvatures, one.curvatures, rtol=1e-9)
    s = np.linspace(0, 1, 50)
    np.testing.assert_allclose(other(s * other.length), one(s * one.length), atol=1e-12)
    # The same vertices are corners, so that arcs of curves stay tangent.
    np.testing.assert_array_equal(one.turns > 1e-9, other.turns > 1e-9)
    assert not {"file", "scale", "names"} & set(written) and "frame" in written
    if drawing == LINES:
        like = written["points"][0][0]
        assert isinstance(like, str) == (path == PLANE)
    else:
        assert {"via", "center", "to"} & set(written["segments"][0])


def test_speeds_and_tolerances_of_segments_and_layers_stay(tmp_path) -> None:
    drawing = f'<g id="CUT">{LINES}</g>'
    layers = PLANE % ", layers: {CUT: {speed: 30 mm/s, tolerance: 0.1 mm}}"
    before, after, written = converted(tmp_path, drawing, layers + "%s")
    assert written["segments"][0]["speed"] == "30 mm/s" and "layers" not in written
    assert after.program.path.speeds.tolist() == [0.03, 0.03]
    assert after.program.path.tolerances.tolist() == pytest.approx([1e-4, 1e-4])
    assert before.process.layers


def test_what_waypoints_do_not_have_is_refused(tmp_path) -> None:
    with pytest.raises(InvalidInput, match="a.svg has 2 contours"):
        converted(tmp_path, LINES + CIRCLE, PLANE)
    layer = "process: {by_layer: {CUT: {overlap: 1 mm}}}\n"
    with pytest.raises(InvalidInput, match="process.by_layer has values for the layer CUT"):
        converted(tmp_path, f'<g id="CUT">{CIRCLE}</g>', PLANE, more=layer)
    table = "x [mm],y [mm],z [mm],ax,ay,az\n400,0,200,0,0,-1\n450,0,200,0,0.1,-1\n"
    (tmp_path / "a.csv").write_text(table)
    text = JOB.format(arm="ur5e", path="{file: a.csv}")
    job, data = parse_job(text, folder=tmp_path), load(text, "")
    state = EditState(data=data, run="own", handles=handles_of(job, data))
    with pytest.raises(InvalidInput, match="a.csv gives the orientation of the tool"):
        changes_of({"do": "to_waypoints"}, state)
