"""The report of an arm in space: what stands in its figures is the study's."""

import numpy as np
import pytest
import yaml

from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.report import render_report, sections

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
def study():
    return run(parse_job(yaml.safe_dump(UR)))


@pytest.fixture(scope="module")
def page(study):
    return render_report(study)


def trace(figure, name):
    (match,) = (x for x in figure.data if x.name == name)
    return match


def test_the_page(page, in_order):
    in_order(page, "notes figures time paths joints")
    for key in ("contours", "shaping"):
        assert f'<details id="{key}">' not in page
    assert len(page) < 2.8e6


def test_executed_paths_have_their_largest_error_and_equal_axes(study):
    figure = sections.paths(study).parts[0]
    scene = figure.layout.scene
    sizes = [np.ptp(scene[f"{c}axis"].range) for c in "xyz"]
    ratios = [scene.aspectratio[c] for c in "xyz"]
    np.testing.assert_allclose(np.divide(sizes, ratios), sizes[0] / ratios[0], rtol=1e-6)
    for name in ("plain", "slow", "tried", "tried, experiment"):
        curve, result = trace(figure, name), study.runs[name.removesuffix(", experiment")]
        points = np.stack([curve.x, curve.y, curve.z], axis=1) * 1e-3
        judged = result.experiment if "experiment" in name else result
        largest = result.path.path.project(points).distance.max()
        assert largest == pytest.approx(judged.evaluation.contour_error.max, rel=1e-2)
