"""Figures, tables and reports of single results in Python."""

import re
from operator import methodcaller

import numpy as np
import pytest

import armcontour as ac

SERVO = ac.ServoModel(25, 150)
# The exact inverse, with which the executed speed is that of the plan.
EXACT = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))


def results(arm, objective, tolerance):
    """A plan, its execution and its evaluation."""
    rounded = ac.round_corners(objective, tolerance=tolerance)
    limits = arm.limits.replace(speed=0.15)
    planned = ac.plan(rounded, arm, limits, ac.Optimal(reserve=0.05))
    executed = ac.simulate(ac.compensate(planned, SERVO, EXACT), ac.ServoPlant(arm, SERVO, limits))
    return planned, executed, ac.evaluate(executed, rounded, objective=objective, limits=limits)


@pytest.fixture(scope="module")
def in_plane(arm):
    corner = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.36, 0.20)])
    return results(arm, corner, 2e-3)


@pytest.fixture(scope="module")
def in_space():
    corner = ac.Path.polyline([(0.4, 0.0, 0.3), (0.5, 0.1, 0.3), (0.5, 0.2, 0.3)])
    return results(ac.load_arm("ur5e"), corner.pointing((0, 0, -1)), 2e-3)


@pytest.fixture(params=["in_plane", "in_space"])
def made(request):
    return request.getfixturevalue(request.param)


def curves(figure):
    return [y for x in figure.plots for y in x.curves]


def test_figures_of_results_show_their_values(made):
    planned, executed, result = made
    for x in made:
        assert curves(x.plot("joints")) and curves(x.plot("speed"))
        assert "<svg" in x.plot("path").svg
    (error,) = curves(result.plot("error"))
    assert len(result.contours) == 1 and np.nanmax(error.y) > 0
    speed, *others = curves(planned.plot("speed"))
    assert speed.x[-1] == pytest.approx(planned.duration, abs=2e-3)
    assert np.nanmax(speed.y) == pytest.approx(1e3 * result.speed, rel=5e-3)
    # The assigned velocity is a line of the figure.
    assert any(np.nanmax(x.y) == pytest.approx(150.0) for x in others)
    joint = curves(planned.plot("joints"))[0]
    expected = planned(np.clip(joint.x, 0, planned.duration))[:, 0]
    np.testing.assert_allclose(joint.y, expected, atol=1e-4)
    assert len(curves(executed.plot("joints"))) == 2 * len(curves(planned.plot("joints")))


def without_code(page):
    """A page without its scripts and styles."""
    return re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)


def test_a_job_that_was_not_simulated_has_a_report(tmp_path):
    from armcontour.cli.run_command import built_in_job

    job_result = ac.run(built_in_job(), simulate=False)
    ac.write_report(job_result, tmp_path / "job_result.html")
    page = (tmp_path / "job_result.html").read_text(encoding="utf-8")
    assert '<details id="time">' in page and "contour error" not in without_code(page)
    first = next(iter(job_result.runs.values()))
    ac.write_report(first, tmp_path / "run.html")
    assert curves(first.plot("speed"))


def test_a_program_has_figures_and_a_report(arm, tmp_path):
    contours = [
        ac.Contour(ac.Path.polyline(x))
        for x in ([(0.35, 0.1), (0.38, 0.12)], [(0.40, 0.15), (0.36, 0.2)])
    ]
    program = ac.Program([contours[0], ac.Rapid(), ac.Dwell(0.1), contours[1]])
    planned = ac.plan(program, arm, arm.limits.replace(speed=0.1))
    ac.write_report(planned, tmp_path / "plan.html")
    page = (tmp_path / "plan.html").read_text(encoding="utf-8")
    assert '<details id="contours">' in page
    assert "<svg" in planned.plot("path").svg


def test_evaluations_without_their_execution_are_refused(in_plane, refuses, tmp_path):
    from dataclasses import replace

    alone = replace(in_plane[2], judged=None)
    refuses(lambda: alone.plot("error"), ac.InvalidInput)
    refuses(lambda: ac.write_report(alone, tmp_path / "a.html"), ac.InvalidInput)


# What a notebook shows of a value.
as_html = methodcaller("_repr_html_")


def test_notebooks_show_picture_and_rows(made, in_space):
    rounded = in_space[0].path
    for x in (*made, rounded, ac.Program.from_path(rounded)):
        page = as_html(x)
        assert "<svg" in page and "<tr>" in page and "<script" not in page
    length = f"{1e3 * rounded.length:.0f} mm"
    assert f"<td>{length}</td>" in as_html(rounded)
    times = re.findall(r"<td>([\d.]+) s</td>", as_html(made[0]))
    assert made[0].duration == pytest.approx(float(times[0]), rel=5e-3)
    named = ac.Program((ac.Contour(rounded),), source="<script>&")
    assert "<script" not in as_html(named) and "&lt;script&gt;&amp;" in as_html(named)
    # Without an arm, a notebook shows the `repr`.
    joints = ac.JointPath.spline([[0.0, 0.0], [0.3, 0.2], [0.5, 0.1]])
    limits = ac.Limits(joint_velocity=1.0, joint_acceleration=3.0)
    assert as_html(ac.plan(joints, limits=limits)) is None


def test_paths_have_a_picture_of_their_outline_only(refuses):
    square = ac.Path.polyline([(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)], closed=True)
    assert "<svg" in square.plot().svg
    refuses(lambda: square.plot("speed"), ac.InvalidInput)
