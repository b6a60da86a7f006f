"""A little of `soak.kerf`: parts that planned tool paths cut, compared with drawings."""

from pathlib import Path

import pytest
from soak import kerf
from tests.geometry.tables import each

import armcontour as ac

DRAWINGS = sorted(Path(__file__).parents[2].glob("examples/drawings/*.[ds][xv][fg]"))


def test_plates_with_holes_islands_blocks_and_layers_have_the_drawn_size():
    for seed in (3, 8):
        kind, verdict = kerf.run_plate(seed)
        assert "refused" not in kind, seed
        assert 0 < verdict.reached, seed


@each("file", DRAWINGS)
def test_parts_of_the_sample_drawings_have_the_drawn_size(file):
    assert kerf.run_file(file, kerf=2e-4)[1] is not None


WRONG = [{"kerf": None}, {"kerf_side": "right"}, {"kerf": 1.996e-4}, {"kerf": 5e-4}]


@pytest.mark.parametrize("wrong", WRONG, ids=str)
def test_the_judge_sees_wrong_sides_and_widths(wrong, monkeypatch):
    made = ac.Process
    monkeypatch.setattr(ac, "Process", lambda **fields: made(**fields | wrong))
    with pytest.raises(AssertionError, match="wrong side|into the part|left over"):
        kerf.run_file(DRAWINGS[0], kerf=2e-4)
