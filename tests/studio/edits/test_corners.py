"""Edits of single corners."""

from __future__ import annotations

from tests.studio.edits.editing import PLANE, edited

from armcontour._yaml import load


def test_single_corners_get_a_tolerance_and_lose_it() -> None:
    found = edited(PLANE, "mac", do="corner_tolerance", index=1, value=2e-3)
    assert found["corners"] == {"tolerance": "5 mm", "at": {2: "2 mm"}}
    text = PLANE.replace("5 mm}", "5 mm, at: {2: 1.5 mm}}")
    typed = edited(text, "mac", do="corner_tolerance", index=1, value="0.5")
    assert typed["corners"]["at"] == {2: "0.5 mm"}
    gone = edited(text, "mac", do="corner_tolerance", index=1, value=None)
    assert gone == load(PLANE, "")
