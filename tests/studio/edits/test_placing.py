"""Edits of where the part lies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.studio.edits.editing import CHAIN, PLANE, SPACE, TURNED, edited, state_of

from armcontour.studio.handles import handles_of


@pytest.mark.parametrize("text", [PLANE, TURNED, CHAIN, SPACE])
@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-3, 3))
def test_the_part_is_moved_and_turned_as_a_whole(text, u, v, turn) -> None:
    handles = state_of(text).handles
    about = handles.waypoints[1].uv + [0.01, -0.02]
    found = edited(text, do="place", by=[u, v], turn=turn, about=about.tolist())
    moved = handles_of(handles.job, found)
    c, s = math.cos(turn), math.sin(turn)
    for before, after in zip(handles.waypoints, moved.waypoints, strict=True):
        if before.why_not is None:
            wanted = about + np.array([[c, -s], [s, c]]) @ (before.uv - about) + [u, v]
            np.testing.assert_allclose(handles.plane.uv(after.point), wanted, atol=1e-12)
    kept = found["path"]["frame"]["position"][2]
    assert kept in (0, "0 mm") or text == SPACE


def test_a_frame_keeps_the_form_in_which_it_is_written() -> None:
    found = edited(TURNED, do="place", by=[0.0125, 0.0])
    assert found["path"]["frame"] == {"position": ["22.5 mm", 0.02, 0], "rpy": [0, 0, "30 deg"]}
    found = edited(TURNED, do="place", turn=math.radians(15), about=[0.01, 0.02])
    assert found["path"]["frame"] == {"position": ["10 mm", 0.02, 0], "rpy": [0, 0, "45 deg"]}
    quaternion = TURNED.replace("rpy: [0, 0, 30 deg]", "quaternion: [0, 0, 0, 1]")
    turned = edited(quaternion, do="place", turn=math.pi / 2)["path"]["frame"]["quaternion"]
    np.testing.assert_allclose(turned, [0, 0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-15)
