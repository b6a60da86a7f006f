"""Executions as frames for the screen."""

import numpy as np
import pytest
from tests.studio.drawn import packed, uv

from armcontour.evaluation import evaluate
from armcontour.studio.executed import executed_frame


@pytest.fixture(scope="module")
def done(previewer_of_plans, plans, view):
    executed = previewer_of_plans.execute(plans["uncompensated"])
    return executed, packed(executed_frame(executed, view))


def test_errors_are_those_of_an_evaluation(done):
    executed, frame = done
    e = evaluate(executed.execution, executed.planned.path).contour_error
    assert frame.header["rms"] == pytest.approx(e.rms, rel=1e-12)
    assert frame.header["max"] == pytest.approx(e.max, rel=1e-12)
    assert frame.header["max_at"]["t"] == pytest.approx(e.t_max)
    assert frame.arrays["error"].max() == pytest.approx(e.max, rel=1e-6)
    assert frame.header["settled"] == executed.settled


def test_offsets_lead_from_the_path_to_the_tool(done, view):
    executed, frame = done
    a, path = frame.arrays, executed.planned.path.path
    execution = executed.execution
    tool = execution.tool[np.abs(execution.t - a["t"][:, None]).argmin(axis=1)]
    found = a["base"] + view.centre + a["offset"]
    np.testing.assert_allclose(found, uv(view, tool), rtol=0, atol=2e-7)
    np.testing.assert_allclose(
        np.linalg.norm(a["offset"], axis=1), a["error"], rtol=1e-4, atol=1e-12
    )
    base = a["base"] + view.centre + view.plane.origin[:2]
    assert path.project(base.astype(float)).distance.max() < 1e-7
    # Small errors have as many digits as large ones.
    t = a["t"].astype(float)
    k = int(np.argmin(np.where((t > 1) & (t < 4), a["error"], 1)))
    exact = executed.pieces[0].found.distance[np.abs(executed.execution.t - t[k]).argmin()]
    assert a["error"][k] == pytest.approx(exact, rel=1e-4)


def test_demand_is_a_share_of_the_limits(done):
    executed, frame = done
    e = evaluate(executed.execution, executed.planned.path)
    np.testing.assert_allclose(frame.header["demand"], e.demand_ratio, rtol=1e-12)
    assert np.abs(frame.arrays["demand"]).max() <= e.demand_ratio.max() * (1 + 1e-6)


def test_the_arm_is_played_closely_also_between_contours(
    previewer_of_plans, plans, gasket_plan, view
):
    for planned in (plans["proposed"], gasket_plan):
        executed = previewer_of_plans.execute(planned)
        a, execution = packed(executed_frame(executed, view)).arrays, executed.execution
        played = [np.interp(execution.t, a["pose_t"], q) for q in a["q"].T]
        np.testing.assert_allclose(np.transpose(played), execution.q, rtol=0, atol=1e-4)
        tool = execution.arm.forward(a["q"])
        np.testing.assert_allclose(a["xyz"][:, : tool.shape[1]], tool, rtol=0, atol=1e-7)
