"""What was refused, and where."""

import numpy as np
import pytest
from tests.studio.drawn import packed, uv

from armcontour.errors import ArmContourError, Collision, ExecutionError, Unreachable
from armcontour.studio.preview import Previewer
from armcontour.studio.refusals import refusal_header
from armcontour.studio.wire import Frame


def test_a_place_out_of_reach_is_where_it_is(paper, view):
    path = {"points": [[0.35, 0.1], [0.41, 0.15], [0.9, 0.3], [0.35, 0.35]]}
    with pytest.raises(Unreachable) as caught:
        Previewer().plan(paper | {"path": path}, "optimal")
    error = caught.value
    waypoints = uv(view, np.array(path["points"]))
    told = refusal_header(error, view, tier=1, run="optimal", waypoints=waypoints)
    assert told["sentence"] == str(error) and told["exit"] == 3
    assert (told["error"], told["tier"], told["run"]) == ("Unreachable", 1, "optimal")
    np.testing.assert_allclose(told["at"]["uv"], uv(view, np.array(error.point)))
    packed(Frame("refusal", told))


def test_a_waypoint_is_named_where_the_error_is_at_one(view):
    error = Unreachable("Too far.", point=(0.4, 0.2), s=0.3, joint=2)
    waypoints = uv(view, np.array([[0.1, 0.1], [0.4, 0.2]]))
    told = refusal_header(error, view, tier=1, waypoints=waypoints)
    assert told["at"]["waypoint"] == 1
    assert (told["at"]["s"], told["at"]["joint"]) == (0.3, 2)
    away = refusal_header(error, view, tier=1, waypoints=waypoints[:1])
    assert "waypoint" not in away["at"]


def test_a_time_has_the_place_of_the_plan(plans, view):
    planned = plans["optimal"]
    error = ExecutionError("It did not rest.", t=2.0, joint=1)
    told = refusal_header(error, view, tier=2, planned=planned)
    tool = planned.job.arm.forward(planned.trajectory(2.0))
    np.testing.assert_allclose(told["at"]["uv"], uv(view, tool))


def test_errors_without_a_place_have_none(view):
    told = refusal_header(Collision("Somewhere."), view, tier=3)
    assert told["at"] == {} and told["exit"] == 8
    assert issubclass(Collision, ArmContourError)
