"""The report of an arm in space: what stands in its figures is the study's."""

import dataclasses
import json
import re

import numpy as np
import pytest
import yaml
from plotly.offline import get_plotlyjs

from armcontour.io import parse_job
from armcontour.jobs import Study, run
from armcontour.report import render_report, sections
from armcontour.report.sections.corners import replaced_paths
from armcontour.report.sections.space import FRAMES

UR = yaml.safe_load("""
name: corner
arm: ur5e
path:
  points: [[0.4, 0, 0.2], [0.5, 0, 0.2], [0.5, 0.1, 0.25]]
  orientation: {rpy: [3.141592653589793, 0, 0]}
limits: {speed: 0.25, centripetal_acceleration: 1, angular_speed: 1}
corners: {tolerance: 1 mm, angular_tolerance: 1 deg}
servo: {kp: 25, kv: 150}
experiment: {runs: [tried]}
runs:
  plain: {compensation: {method: none}}
  slow: {limits: {speed: 0.1}, command_interval: 10 ms}
  tried: {}
""")
PANDA = yaml.safe_load("""
name: line
arm: panda
path: {points: [[0.4, 0, 0.3], [0.45, 0.05, 0.3]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.25}
servo: {kp: 25, kv: 150}
runs: {one: {}}
""")


def run_ur(**changes):
    without = {key: x for key, x in UR.items() if key != "experiment"}
    return run(parse_job(yaml.safe_dump(without | changes)))


@pytest.fixture(scope="module")
def study():
    return run(parse_job(yaml.safe_dump(UR)))


@pytest.fixture(scope="module")
def page(study):
    return render_report(study)


def trace(figure, name):
    (found,) = (x for x in figure.data if x.name == name)
    return found


def test_the_page(page, in_order):
    in_order(page, "overview paths speed bindings joints contour-error")
    for key in ("joint-space", "accelerations", "torques"):
        assert f'<section id="{key}">' not in page
    assert len(page) - len(get_plotlyjs()) < 2.5e6


def test_executed_paths_have_their_largest_error_and_equal_axes(study):
    figure = sections.space(study).figures[0]
    scene = figure.layout.scene
    sizes = [np.ptp(scene[f"{c}axis"].range) for c in "xyz"]
    ratios = [scene.aspectratio[c] for c in "xyz"]
    np.testing.assert_allclose(np.divide(sizes, ratios), sizes[0] / ratios[0], rtol=1e-6)
    for name in ("plain", "slow", "tried", "tried, experiment"):
        found, result = trace(figure, name), study.runs[name.removesuffix(", experiment")]
        points = np.stack([found.x, found.y, found.z], axis=1) * 1e-3
        judged = result.experiment if "experiment" in name else result
        largest = result.path.path.project(points).distance.max()
        assert largest == pytest.approx(judged.evaluation.contour_error.max, rel=1e-2)


def test_the_arm_moves_as_executed(study):
    figure = sections.space(study).figures[-1]
    assert len(figure.frames) == len(figure.layout.sliders[0].steps) == FRAMES
    arms = ["plain", "slow", "tried"]
    names = ["objective path", *arms, "plane of the base", "base_link_inertia"]
    assert [x.name for x in figure.data] == names
    for k in (0, FRAMES // 2):
        t = float(figure.layout.sliders[0].steps[k].label)
        for data, name in zip(figure.frames[k].data, arms, strict=True):
            done = study.runs[name].execution
            q = [np.interp(t, done.t, x) for x in done.q.T]
            links = done.arm.links(np.array(q)) * 1e3
            np.testing.assert_allclose(np.stack([data.x, data.y, data.z], axis=1), links, atol=3)
    # Arms that would hide each other wait in the legend.
    assert [x.visible for x in figure.data[1:4]] == [None, None, "legendonly"]


def test_joints_with_their_limits(study, page):
    section = sections.joints(study)
    assert len(section.figures) == len(section.tables) == 3
    table = section.tables[0]
    assert table.header[-1] == "planned torque [N m]"
    assert [x[0] for x in table.rows] == list(study.job.arm.joint_names)
    speed = np.abs(study.runs["plain"].execution.dq[:, 0]).max()
    assert table.rows[0][3] == f"{speed:.4g} of 3.142 ({speed / np.pi:.0%})"
    assert {x.name for x in section.figures[2].data} == {"planned", "executed", "experiment"}
    assert {x.name for x in section.figures[0].data} == {"planned", "executed"}
    assert "About the masses: " in page

    (first, *_) = study.runs.values()
    upper, lower = np.array([[np.inf, 6.0, 3.0, 6.0, 6.0, np.inf], [-np.inf, *(5 * [-6.0])]])
    limits = first.run.limits.replace(joint_lower=lower, joint_upper=upper)
    free = dataclasses.replace(first, run=dataclasses.replace(first.run, limits=limits))
    table = sections.joints(Study(job=study.job, runs={"a": free})).tables[0]
    ranges = [table.rows[j][1] for j in (0, 1, 5)]
    assert ranges == ["free", "-6.000 to 6.000", "-6.000 to free"]


def test_experiments_over_time_and_the_orientation_error(study, page):
    section = sections.contour_error(study)
    (found,) = (x for x in section.figures[0].data if x.name.startswith("tried, experiment"))
    rms = f"{study.runs['tried'].experiment.evaluation.contour_error.rms * 1e3:.4f}"
    assert f"{rms}, largest" in found.name and f"{rms} mm" in page
    assert found.line.dash == "dot"
    (table,) = sections.overview(study).tables
    found = dict(zip(table.header, table.rows[0], strict=True))
    error = study.runs["plain"].evaluation.orientation_error
    assert found["orientation error, largest"] == f"{np.degrees(error.max):.4f} deg"


def test_seven_joints_have_a_report():
    study = run(parse_job(yaml.safe_dump(PANDA)))
    page = render_report(study)
    assert "panda_joint7" in page
    assert "tool x axis" not in {x.name for x in sections.space(study).figures[0].data}
    # What is embedded is JSON, without numbers that are none.
    given = re.findall(r'<script>draw\("[^"]+",(.*?)\);</script>', page, re.DOTALL)
    assert given and not any("NaN" in x for x in given)
    json.loads(f"[[{'],['.join(given)}]]")


def test_accelerations_have_a_limit_per_direction_and_jerk_has_one():
    own = {"joint_acceleration": 10, "joint_deceleration": 4, "joint_jerk": 200}
    study = run_ur(runs={"one": {}}, limits={**UR["limits"], **own})
    (table, *_) = sections.joints(study).tables
    result = study.runs["one"]
    ddq, jerk = result.execution.ddq, result.evaluation.jerk
    assert table.header[5] == "jerk [rad/s³]"
    for j, row in enumerate(table.rows):
        down, up = -ddq[:, j].min(), ddq[:, j].max()
        share = max(down / 4, up / 10)
        limit = 4 if down / 4 > up / 10 else 10
        assert share <= 1e-3 or row[4].endswith(f"of {limit} ({share:.0%})")
        assert row[5].endswith(f"of 200 ({jerk[j] / 200:.0%})")
    assert replaced_paths(study) == "the rounded path (rounded with continuous curvature)"
