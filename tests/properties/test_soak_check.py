"""The first printed trajectories of the soak of `check`; `make soak` judges many more."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from soak.check import FORWARD, REACH, draw, judge, load

COUNT = 40


@pytest.mark.parametrize("violating", [True, False])
def test_no_verdict_contradicts_what_the_samples_prove(violating):
    outcomes = [judge(draw(seed, violating)) for seed in range(COUNT)]
    wrong = [
        f"seed {x.case.seed} ({x.case.kind}, {x.case.arm}, {x.case.limit}): {x.said}, {x.proof}"
        for x in outcomes
        if x.wrong
    ]
    assert not wrong, "\n".join(wrong)
    said = Counter(x.said for x in outcomes)
    # Most are decided, so that "cannot tell" is no way out.
    assert said["violated" if violating else "kept"] > COUNT * 0.6


@pytest.mark.parametrize("name", ["pmk3s", "ur5e"])
def test_the_oracle_knows_where_the_tool_is(name):
    arm, dof = load(name), len(REACH[name])
    q = np.random.default_rng(0).uniform(-3, 3, (200, dof))
    # The controller's base may be turned against the oracle's: distances tell.
    for k in (1, 7):
        distances = [
            np.linalg.norm(x[k:] - x[:-k], axis=1) for x in (FORWARD[name](q), arm.forward(q))
        ]
        np.testing.assert_allclose(*distances, atol=1e-12)
    for j in range(dof):
        moved = q.copy()
        moved[:, j] += 1e-6
        step = np.linalg.norm(FORWARD[name](moved) - FORWARD[name](q), axis=1)
        assert (step <= 1e-6 * REACH[name][j] * (1 + 1e-6)).all()
