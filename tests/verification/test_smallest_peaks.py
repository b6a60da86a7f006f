"""`check` between samples: the smallest peaks of all motions through two samples."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog

import armcontour as ac

ARM = ac.load_arm("pmk3s")
# Number of cells in which the linear programs vary the highest derivative.
CELLS = 160


def samples(t, states):
    """Samples of joint 2, whose position and derivatives are the columns of `states`."""
    columns = [np.outer(x, [0.0, 1.0]) for x in np.transpose(states)]
    return SimpleNamespace(t=t, **dict(zip(("q", "dq", "ddq"), columns, strict=False)))


def advance(state, span, top):
    """State after a time with a constant derivative of the highest order."""
    terms = [*state, top]
    factorials = (1.0, 1.0, 2.0, 6.0)
    return [
        sum(x * span**k / factorials[k] for k, x in enumerate(terms[order:]))
        for order in range(len(state))
    ]


def smallest_factor(first, last, span, low, high):
    """Smallest factor of the bounds with which a motion connects two states, by linear programs."""
    ends = np.linspace(0, span, CELLS + 1)
    # Effect of the highest derivative in each cell on the state at the end.
    remaining = span - ends
    order = len(first)
    effects = [
        (remaining[:-1] ** k - remaining[1:] ** k) / (1.0, 1.0, 2.0, 6.0)[k]
        for k in range(order, 0, -1)
    ]
    change = np.subtract(last, advance(first, span, 0.0))
    scale = span ** np.arange(order, 0, -1)
    identity = np.eye(CELLS)
    ones = np.ones((CELLS, 1))
    result = linprog(
        [*np.zeros(CELLS), 1.0],
        A_ub=np.block([[identity, -high * ones], [-identity, low * ones]]),
        b_ub=np.zeros(2 * CELLS),
        A_eq=np.column_stack([effects / scale[:, None], np.zeros(order)]),
        b_eq=change / scale,
        bounds=[(None, None)] * CELLS + [(0, None)],
    )
    assert result.status == 0, result.message
    return result.x[-1]


def limits(order, low, high):
    if order == 2:
        return ac.Limits.only(joint_acceleration=[[low, high]])
    return ac.Limits.only(joint_jerk=high)


def certain(log, order, low, high):
    (use,) = ac.check(log, ARM, limits(order, low, high)).uses
    return use.certain


@pytest.mark.parametrize("order", [2, 3])
def test_proven_limit_ratio_of_two_samples_equals_linear_program(order):
    random = np.random.default_rng(order)
    for _ in range(20):
        high, span = 10 ** random.uniform(-1, 1, 2)
        low = -high * 10 ** random.uniform(-0.7, 0.7) if order == 2 else -high
        first = random.normal(size=order)
        # Changes of one or of several derivatives, of different sizes.
        offsets = random.normal(size=order) * 10 ** random.uniform(-2, 1, order)
        offsets *= random.random(order) < 0.7
        last = advance(first, span, 0.0) + high * offsets * span ** np.arange(order, 0, -1)
        exact = smallest_factor(first, last, span, low, high)
        bound = certain(samples([0.0, span], [first, last]), order, low, high)
        # The cells restrict the motion, so the linear program is slightly larger.
        assert bound <= exact * (1 + 1e-9) + 1e-9
        assert bound == pytest.approx(exact, rel=1e-3, abs=1e-6)


def motion(random, order, low, high, need):
    """Samples of a motion that needs a multiple of the bounds in one interval only."""
    count = 20
    span = 10 ** random.uniform(-3, -1)
    spans = span * random.choice([np.ones(count), random.uniform(0.5, 2, count)])
    worst = random.integers(count)
    states = [list(random.normal(size=order) * span)]
    for k, whole in enumerate(spans):
        # In the interval, the highest derivative has no more switches than the smallest one has.
        ends = np.sort(np.concatenate([[0, 1], random.uniform(0.1, 0.9, order - 1)])) * whole
        up = (np.arange(order) + random.integers(2)) % 2
        size = need if k == worst else 0.9 * min(need, 1.0) * random.random(order)
        state = states[-1]
        for part, top in zip(np.diff(ends), np.where(up, high, low) * size, strict=True):
            state = advance(state, part, top)
        states.append(state)
    return samples(np.concatenate([[0.0], np.cumsum(spans)]), states)


@pytest.mark.parametrize("order", [2, 3])
def test_only_motions_that_require_more_than_a_limit_are_violations(order):
    random = np.random.default_rng(10 + order)
    for _ in range(60):
        high = 10 ** random.uniform(-1, 2)
        low = -high * 10 ** random.uniform(-0.6, 0.6) if order == 2 else -high
        for need, verdict in ((random.uniform(1.05, 3), "violated"), (0.95, "kept")):
            log = motion(random, order, low, high, need)
            check = ac.check(log, ARM, limits(order, low, high))
            assert check.verdict == verdict, (need, check)
            # The motion reaches the bound.
            assert check.worst.certain == pytest.approx(need, rel=1e-6)


def test_positions_that_contradict_velocities_are_found():
    arm = ac.load_arm("ur5e")
    t = np.arange(101) / 100
    start = np.array([0, -1, 1.2, -1, -1.5, 0])
    size = np.linspace(0.06, 0.2, 6)
    angle = 2 * np.pi * t[:, None]
    log = SimpleNamespace(
        t=t,
        q=start + size * np.sin(angle),
        dq=2 * np.pi * size * np.cos(angle),
        ddq=-((2 * np.pi) ** 2) * size * np.sin(angle),
    )
    names = {"joint_acceleration": 10.0, "joint_jerk": 400.0}
    allowed = {**names, "tool_acceleration": 6.0}
    for name, limit in allowed.items():
        assert ac.check(log, arm, ac.Limits.only(**{name: limit})).verdict == "kept", name
    log.q[40:, 1] += 4e-4
    for name, limit in allowed.items():
        (use,) = ac.check(log, arm, ac.Limits.only(**{name: limit})).uses
        assert use.verdict == "violated" and use.t == pytest.approx(0.395), name
    # 0.4 mrad in 10 ms: at least 4 D / T², and for the jerk 32 D / T³.
    (use,) = ac.check(log, arm, ac.Limits.only(joint_acceleration=10.0)).uses
    assert use.value == pytest.approx(16.0, abs=0.5)
    (use,) = ac.check(log, arm, ac.Limits.only(joint_jerk=400.0)).uses
    assert use.value == pytest.approx(12_800, abs=30)
    (use,) = ac.check(
        SimpleNamespace(t=log.t, q=log.q, dq=log.dq), arm, ac.Limits.only(joint_jerk=400.0)
    ).uses
    assert use.value >= 12 * 4e-4 / 1e-6 - 30
