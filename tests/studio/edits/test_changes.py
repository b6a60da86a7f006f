"""What a page sends as an edit."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.studio.edits.editing import CHAIN, PLANE, state_of

from armcontour.errors import InvalidInput
from armcontour.io.job_edits import change_data
from armcontour.studio.edits import EDITS, changes_of


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ({"do": "fly"}, "There is no edit 'fly': the edits are set, unset"),
        ({"do": "set", "key": "limits.speed"}, "The edit set lacks value"),
        ({"do": "set", "key": "", "value": 1}, "'' is no key"),
        ({"do": "set", "key": "limits.speed", "value": math.nan}, "limits.speed"),
        ({"do": "move_waypoint", "index": 9, "to": [0, 0]}, "number of the waypoint"),
        ({"do": "move_waypoint", "index": 1, "to": [0, math.inf]}, "to"),
        ({"do": "move_waypoint", "index": 1, "to": [0]}, "two coordinates"),
        ({"do": "to_waypoints"}, "waypoints of the job already"),
        ({"do": "corner_tolerance", "index": None, "value": 1}, "at no waypoint of a path"),
    ],
)
def test_edits_that_make_no_sense_are_refused(edit, words) -> None:
    with pytest.raises(InvalidInput, match=words):
        changes_of(edit, state_of(PLANE))


WORDS = ("", ".", "limits.speed", "5 mm", "1", "add", "change", "box", "own", "corners.at.2", "mac")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.sampled_from(WORDS),
    lambda x: st.lists(x, max_size=3) | st.dictionaries(st.sampled_from(WORDS), x, max_size=2),
    max_leaves=4,
)
VALID: tuple[dict[str, Any], ...] = (
    {"do": "set", "key": "limits.speed", "value": 0.1},
    {"do": "unset", "key": "limits.speed"},
    {"do": "move_waypoint", "index": 1, "to": [0.3, 0.2], "step": 1e-4},
    {"do": "set_waypoint", "index": 1, "value": ["1 mm", 2]},
    {"do": "insert_waypoint", "index": 1, "at": [0.3, 0.2]},
    {"do": "remove_waypoint", "index": 1},
    {"do": "corner_tolerance", "index": 1, "value": "1 mm"},
    {"do": "place", "by": [0.1, 0], "turn": 0.1, "about": [0, 0]},
    {"do": "to_waypoints"},
    {"do": "obstacle", "action": "change", "kind": "box", "index": 0, "size": [1, 1, 1]},
)
BOXED = PLANE + "scene: {boxes: [{name: box, size: [1, 1 m, 1], at: [0, 0, 0]}]}\n"


@given(st.sampled_from(VALID), st.sampled_from([BOXED, CHAIN]), st.data())
@settings(max_examples=150)
def test_whatever_a_page_sends_is_a_change_or_one_sentence(valid, text, draw) -> None:
    fields = [x for x in valid if x != "do"] or ["do"]
    edit = {**valid, draw.draw(st.sampled_from(fields)): draw.draw(JSON)}
    state = state_of(text)
    try:
        found = change_data(state.data, changes_of(edit, state))
    except InvalidInput as error:
        assert str(error).endswith((".", "?"))
    else:
        assert isinstance(found, dict)


def test_every_edit_is_tried_with_nonsense() -> None:
    assert {x["do"] for x in VALID} == set(EDITS)
