"""Edits of obstacles."""

from __future__ import annotations

import pytest
from tests.studio.edits.editing import PLANE, edited

from armcontour.errors import InvalidInput


def test_obstacles_are_added_changed_and_removed() -> None:
    add = {"do": "obstacle", "action": "add", "kind": "box", "size": [0.1, "2 cm", 0.3]}
    found = edited(PLANE, **add, at=[0, 0, 0.5])
    assert found["scene"] == {
        "boxes": [
            {"name": "box", "size": ["100 mm", "2 cm", "300 mm"], "at": ["0 mm", "0 mm", "500 mm"]}
        ]
    }
    text = PLANE + "scene: {boxes: [{name: box, size: [1, 1, 1]}, {name: b, size: [1 m, 2, 3]}]}\n"
    assert edited(text, **add)["scene"]["boxes"][2]["name"] == "box 2"
    change = {"do": "obstacle", "action": "change", "kind": "boxes", "index": 1}
    found = edited(text, **change, size=[1.5, 2, 3], at=[0.1, 0, 0], name="c")
    assert found["scene"]["boxes"][1] == {
        "name": "c",
        "size": ["1.5 m", 2, 3],
        "at": ["100 mm", "0 mm", "0 mm"],
    }
    remove = {"do": "obstacle", "action": "remove", "kind": "box"}
    assert len(edited(text, **remove, index=0)["scene"]["boxes"]) == 1
    one = PLANE + "scene: {boxes: [{name: box, size: [1, 1, 1]}]}\n"
    assert edited(one, **remove, index=0)["scene"] == {}
    with pytest.raises(InvalidInput, match="number of the obstacle"):
        edited(one, **remove, index=1)
    with pytest.raises(InvalidInput, match="kind of obstacles"):
        edited(one, do="obstacle", action="add", kind="cone")
