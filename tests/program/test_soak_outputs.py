"""A little of `soak.outputs`: outputs of random programs on every sample of their plans."""

from __future__ import annotations

import dataclasses

import pytest
from soak import outputs

import armcontour as ac


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_outputs_are_on_at_work_only(first: int) -> None:
    assert sum(outputs.run(seed) for seed in range(first, first + 10)) > 1000


@pytest.mark.parametrize("by", [-3e-4, 3e-4])
def test_the_judge_sees_events_at_wrong_places(by: float, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare = ac.prepare

    def shifted(program: ac.Program, process: ac.Process) -> ac.Program:
        found = prepare(program, process)
        moves = [
            dataclasses.replace(
                x,
                events=[
                    dataclasses.replace(y, s=min(max(y.s + by, 0.0), x.path.length))
                    for y in x.events
                ],
            )
            if isinstance(x, ac.Contour)
            else x
            for x in found.moves
        ]
        return dataclasses.replace(found, moves=tuple(moves))

    monkeypatch.setattr(outputs.ac, "prepare", shifted)
    seen = 0
    for seed in range(10):
        try:
            outputs.run(seed)
        except AssertionError as error:
            assert "without work" in str(error) or "at work" in str(error)
            seen += 1
    # Along active leads an output may be on, so that some shifts there are no error.
    assert seen >= 8
