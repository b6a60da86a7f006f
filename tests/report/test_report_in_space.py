"""The report of an arm in space: its values equal those of the job_result."""

import re

import numpy as np
import pytest
import yaml

from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.report import render_report, sections
from armcontour.report.sheet import OBLIQUE

UR = yaml.safe_load("""
name: corner
arm: ur5e
path:
  points: [[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.25]]
  orientation: {rpy: [3.141592653589793, 0, 0]}
limits: {speed: 0.25, centripetal_acceleration: 1, angular_speed: 1}
corners: {tolerance: 1 mm, angular_tolerance: 1 deg}
servo: {kp: 25, kv: 150}
experiment: {}
runs:
  plain: {compensation: {method: none}}
  slow: {limits: {speed: 0.1}, cycle: 10 ms}
  tried: {}
""")


@pytest.fixture(scope="module")
def job_result():
    return run(parse_job(yaml.safe_dump(UR)))


@pytest.fixture(scope="module")
def page(job_result):
    return render_report(job_result)


def test_the_report_in_space_has_its_sections_in_order(page, in_order):
    in_order(page, "notes figures time paths joints")
    for key in ("contours", "shaping"):
        assert f'<details id="{key}">' not in page
    assert len(page) < 0.95e6


def test_the_drawn_executed_path_is_that_of_the_tool(job_result):
    section = sections.paths(job_result)
    names = [x for x, _ in section.choices]
    assert set(names) == {x + y for x in job_result.runs for y in ("", ", experiment")}
    tools = {x.name: x for x in sections.path_section.tools_of(job_result)}
    for name, (drawing,) in section.choices:
        curves = re.findall(r'<path class="limit path"[^>]* d="([^"]*)"', drawing.svg)
        drawn = np.array(" ".join(curves).replace("M", " ").split(), float).reshape(-1, 2)
        tool = tools[name].execution.tool
        x, y = np.ptp(drawn, axis=0)
        across, up = np.ptp(tool @ OBLIQUE.T, axis=0)
        # The scale is the same in both directions.
        assert x / across == pytest.approx(y / up, rel=5e-3)
