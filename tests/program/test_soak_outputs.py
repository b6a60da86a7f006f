"""A little of `soak.outputs`: outputs of random programs on every sample of their plans."""

import dataclasses

import pytest
from soak import outputs

import armcontour as ac


def test_outputs_are_on_at_work_only():
    assert sum(outputs.judge_program(seed) for seed in range(30)) > 3000


@pytest.mark.parametrize("by", [-3e-4, 3e-4])
def test_the_judge_sees_events_at_wrong_places(by, monkeypatch):
    prepare = ac.prepare

    def moved(x):
        places = [min(max(y.s + by, 0.0), x.path.length) for y in x.events]
        events = [dataclasses.replace(y, s=s) for y, s in zip(x.events, places, strict=True)]
        return dataclasses.replace(x, events=events)

    def shifted(program, process):
        found = prepare(program, process)
        moves = (moved(x) if isinstance(x, ac.Contour) else x for x in found.moves)
        return dataclasses.replace(found, moves=tuple(moves))

    monkeypatch.setattr(outputs.ac, "prepare", shifted)
    seen = 0
    for seed in range(10):
        try:
            outputs.judge_program(seed)
        except AssertionError as error:
            assert "without work" in str(error) or "at work" in str(error)
            seen += 1
    # Along active leads an output may be on, so that some shifts there are no error.
    assert seen >= 8
