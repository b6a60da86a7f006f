"""A little of `soak.kerf --plates`: parts that planned tool paths cut, compared with drawings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from soak import parts

import armcontour as ac

DRAWINGS = sorted(Path(__file__).parents[2].glob("examples/drawings/*.[ds][xv][fg]"))


@pytest.mark.parametrize("seed", [3, 8])
def test_plates_with_holes_islands_blocks_and_layers_have_the_drawn_size(seed: int) -> None:
    kind, verdict = parts.run(seed)
    assert "refused" not in kind
    assert verdict is not None and 0 < verdict.reached and verdict.lost <= 1e-6 * verdict.area


@pytest.mark.parametrize("file", DRAWINGS, ids=lambda x: x.name)
def test_parts_of_the_sample_drawings_have_the_drawn_size(file: Path) -> None:
    assert parts.run_file(file, kerf=2e-4)[1] is not None


@pytest.mark.parametrize(
    "wrong",
    [{"kerf": None}, {"kerf_side": "right"}, {"kerf": 1.996e-4}, {"kerf": 5e-4}],
    ids=str,
)
def test_the_judge_sees_wrong_sides_and_widths(
    wrong: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = ac.Process

    def process(**given: Any) -> ac.Process:
        return made(**{**given, **wrong})

    monkeypatch.setattr(ac, "Process", process)
    with pytest.raises(AssertionError, match="wrong side|into the part|left over"):
        parts.run_file(DRAWINGS[0], kerf=2e-4)
