"""The first corners of the soak of corners beside arcs; `make soak` judges many more."""

from __future__ import annotations

from collections import Counter

from soak.corners import draw, judge

COUNT = 150


def test_random_corners_beside_arcs_keep_their_tolerance_and_are_tangent():
    wrong, kinds = [], Counter()
    for seed in range(COUNT):
        case = draw(seed)
        problem, stopped = judge(case)
        kinds[case.kind, stopped] += 1
        if problem:
            wrong.append(f"seed {seed} ({case.kind}, turn {case.turn:.6g}): {problem}")
    assert not wrong, "\n".join(wrong)
    # Nearly all are rounded, of every kind.
    assert len({kind for kind, stopped in kinds if not stopped}) == 9
    assert sum(n for (_, stopped), n in kinds.items() if stopped) < COUNT / 50
