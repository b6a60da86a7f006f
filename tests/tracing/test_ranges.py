"""Ranges of joints, and limits that no planner keeps."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.tracing import refuse_out_of_range


def bump(height):
    """Joint 2 rises from 0 to `height` and falls again, between its knots."""
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 1, 0] = 1.0
    coefficients[0, 1:3, 1] = 4 * height, -4 * height
    return ac.JointPath(breaks=np.array([0.0, 2.0]), coefficients=coefficients)


def test_the_top_between_samples_counts(refuses):
    limits = ac.Limits(joint_upper=[2.0, 0.5], joint_lower=[-0.1, -0.1])
    refuse_out_of_range(bump(0.5), limits)
    refuses(
        lambda: refuse_out_of_range(bump(0.5 + 1e-6), limits),
        ac.Unreachable,
        "At 1 m along the path joint 2",
        "1e-06 rad beyond its upper limit of 0.5 rad",
        joint=2,
        s=1.0,
        limit="joint_upper",
        needed=0.500001,
        allowed=0.5,
    )
    refuses(
        lambda: refuse_out_of_range(bump(-0.3), limits),
        ac.Unreachable,
        "beyond its lower limit of -0.1 rad",
        joint=2,
        needed=-0.3,
    )


@pytest.mark.parametrize("seed", range(20))
def test_against_many_samples(seed):
    rng = np.random.default_rng(seed)
    path = ac.JointPath(breaks=np.array([0.0, 1.5]), coefficients=rng.uniform(-1, 1, (1, 6, 3)))
    q = path(np.linspace(0, 1.5, 20_001))
    refuse_out_of_range(path, ac.Limits(joint_lower=q.min() - 1e-6, joint_upper=q.max() + 1e-6))
    with pytest.raises(ac.Unreachable) as caught:
        refuse_out_of_range(path, ac.Limits(joint_upper=q.max() - 0.01))
    assert caught.value.needed == pytest.approx(q.max(), abs=1e-6)
    assert caught.value.joint == 1 + int(np.argmax(q.max(axis=0)))


def test_ranges_may_be_missing_or_endless():
    path = bump(5.0)
    refuse_out_of_range(path, ac.Limits())
    refuse_out_of_range(path, ac.Limits(joint_upper=[np.inf, np.inf]))


@pytest.mark.parametrize("method", ["optimal", "mac", "conventional"])
def test_every_method_refuses(method, traced, arm, limits, refuses):
    narrow = limits.replace(joint_upper=traced(0.0) + 0.01)
    refuses(
        lambda: ac.plan(traced, arm, narrow, method=method),
        ac.Unreachable,
        "beyond its upper limit",
    )
