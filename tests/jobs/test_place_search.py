"""Where a placement looks: checked at birth, replaced key by key."""

import pytest

from armcontour.errors import InvalidInput
from armcontour.jobs import PlaceSearch

OVER = {"x": (0.0, 0.1, 3), "yaw": (0.0, 0.2, 2)}


def test_of_axes_only_those_given_are_replaced() -> None:
    own = PlaceSearch(over=OVER, uncertainty={"x": 1e-3}, every=True, run="only")
    new = own.replaced(
        {"over": {"yaw": (0.1, 0.1, 1), "y": (0, 1, 2)}, "every": False, "objective": None}
    )
    assert new.over == {"x": OVER["x"], "y": (0, 1, 2), "yaw": (0.1, 0.1, 1)}
    assert list(new.over) == ["x", "y", "yaw"]
    assert (new.every, new.objective, new.run) == (False, "cycle", "only")
    assert new.replaced({"uncertainty": {"yaw": 0.1}}).uncertainty == {"x": 1e-3, "yaw": 0.1}
    assert own.over == OVER


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"over": {"w": (0, 1, 2)}}, "over has no axis 'w'"),
        ({"over": {"x": (1, 0, 2)}}, "range of x from 1 to 0 m is empty"),
        ({"over": {"x": (0, 1e5, 2)}}, "over x"),
        ({"uncertainty": {"x": -1}}, "uncertainty of x"),
        ({"objective": "beauty"}, "objective must be one of cycle"),
        ({"what": "table"}, "what must be one of part, base"),
        ({"about": "end"}, "about must be one of middle, origin"),
        ({"about": (0, 0)}, "about is a point of 3 coordinates"),
        ({"about": (0, 0, 1e6)}, "about"),
        ({"about": ("a", 0, 0)}, "about"),
    ],
)
def test_what_makes_no_sense_is_refused(given, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        PlaceSearch(**given)
    with pytest.raises(InvalidInput, match=words):
        PlaceSearch(over=OVER).replaced(given)


def test_axes_are_those_of_the_arm() -> None:
    with pytest.raises(InvalidInput, match="over has no axis 'z' for an arm in the plane"):
        PlaceSearch(over={"z": (0, 1, 2)}).check(2)
    with pytest.raises(InvalidInput, match="uncertainty has no axis 'tilt'"):
        PlaceSearch(uncertainty={"tilt": 0.1}).check(2)
