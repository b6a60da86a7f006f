"""Gaps in the samples of a check, and times that name the sample."""

import re
from types import SimpleNamespace as Samples

import numpy as np
import pytest
from tests.geometry.tables import each

import armcontour as ac
from armcontour.files import parse_trajectory

ARM = ac.load_arm("pmk3s")
STEP = 4e-3
LIMITS = ac.Limits(joint_velocity=[10.0, 10.0], joint_acceleration=[1e3, 1e3])


def motion(t):
    """A slow and smooth motion that starts and ends at rest, with a rest from 1.5 s to 2.5 s."""
    u = np.clip(t / 1.5, 0, 1) + np.clip((t - 2.5) / 1.5, 0, 1)
    share = np.floor(u) + (u % 1) ** 2 * (3 - 2 * (u % 1))
    return np.column_stack([0.3 + 0.4 * share, 1.0 - 0.2 * share])


def checked(t, q=None):
    q = motion(t) if q is None else q
    return ac.check(Samples(t=t, q=q), ARM, LIMITS)


def without(t, *parts):
    kept = np.ones(len(t), dtype=bool)
    for start, end in parts:
        kept &= (t <= start) | (t >= end)
    return t[kept]


WHOLE = STEP * np.arange(1001)


@each("start, end", [(0.5, 0.52), (0.1, 1.4), (1.0, 2.0), (3.0, 3.9), (0.2, 0.216)])
def test_gap_in_samples_leaves_verdict_open(start, end):
    assert checked(WHOLE).verdict == "kept"
    t = without(WHOLE, (start, end))
    check = checked(t)
    assert check.verdict == "cannot tell"
    (gap,) = check.gaps
    assert (gap.start, gap.end) == (pytest.approx(start), pytest.approx(end))
    assert t[gap.row - 1] == gap.start and not gap.at_rest
    assert f"{start:.10g} s (row {gap.row})" in str(check.to_data().notes)
    # A violation is one with a gap, too.
    assert ac.check(Samples(t=t, q=motion(t)), ARM, LIMITS.replace(joint_velocity=0.1)).violated


def test_several_gaps_are_counted():
    t = without(WHOLE, (0.5, 0.6), (0.8, 0.9), (3.0, 3.4))
    check = checked(t)
    assert [x.start for x in check.gaps] == pytest.approx([0.5, 0.8, 3.0])
    assert check.to_data().tables[1].rows[2][:2] == (pytest.approx(3.0), pytest.approx(3.4))


def test_a_gap_while_the_arm_rests_is_noted_only():
    check = checked(without(WHOLE, (1.6, 2.4)))
    assert check.verdict == "kept"
    assert [x.at_rest for x in check.gaps] == [True]
    assert any("1.6 s" in x for x in check.to_data().notes)
    # A periodic motion returns to its position, but does not rest there.
    periodic = without(WHOLE, (0.9, 1.9))
    q = 0.1 * np.column_stack([np.sin(2 * np.pi * periodic), np.cos(2 * np.pi * periodic)])
    assert checked(periodic, q).verdict == "cannot tell"


@each("seed", range(6))
def test_uneven_but_complete_logs_have_no_gaps(seed):
    rng = np.random.default_rng(seed)
    n = 1500
    steps = {
        "jitter": STEP * rng.uniform(0.2, 1.8, n),
        "events": rng.exponential(STEP, n) + 1e-5,
        "heavy": STEP * np.exp(rng.normal(0, 1, n)),
        "two rates": np.repeat([1e-3, 10e-3], [n - n // 20, n // 20]),
        "three rates": np.repeat([1e-3, 8e-3, 2e-3], [n // 2, n // 100, n // 2 - n // 100]),
        "lost now and then": STEP * rng.choice([1, 2], n, p=[0.9, 0.1]),
        "waypoints": rng.choice([0.1, 0.3, 2.0], 12),
    }
    for name, step in steps.items():
        t = np.concatenate([[0.0], np.cumsum(step)])
        q = motion(4 * t / t[-1])
        assert checked(t, q).verdict == "kept", name
        assert checked(t + 1.7e9, q).gaps == (), name
    # Written when a joint has moved by 1 mrad: long intervals while the joints are slow.
    fine = np.linspace(0, 4, 400_001)
    moved = np.abs(np.diff(motion(fine), axis=0)).sum(axis=1).cumsum()
    level = np.round(moved / 1e-3 + rng.random())
    events = fine[1:][np.diff(level, prepend=level[0]) > 0]
    events = np.sort(events + rng.uniform(0, 2e-4, len(events)))
    check = checked(events)
    assert check.verdict == "kept" and all(x.at_rest for x in check.gaps)
    # A second of it is missing.
    lost = without(events, (0.4, 1.2))
    assert checked(lost).verdict == "cannot tell"


@each("seed", range(4))
def test_gaps_in_jittered_logs_are_found(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(STEP * rng.uniform(0.5, 1.5, 1000))
    start = rng.uniform(0.2, 1.0)
    check = checked(without(t, (start, start + 0.1)))
    assert check.verdict == "cannot tell" and len(check.gaps) == 1
    noise = 1e-4 * rng.standard_normal((len(t), 2))
    kept = (t <= start) | (t >= start + 0.1)
    samples = Samples(t=t[kept], q=(motion(t) + noise)[kept])
    assert ac.check(samples, ARM, LIMITS).verdict == "cannot tell"


@each("origin", [0.0, 1.7e9])
@each("step", [0.05, 8e-3, 5e-4])
def test_times_name_the_sample(origin, step):
    t = origin + step * np.arange(60)
    q = np.column_stack([0.3 + 0.01 * np.sin(np.arange(60)), np.full(60, 1.0)])
    q[37] += 0.5
    check = ac.check(Samples(t=t, q=q), ARM, ac.Limits(joint_velocity=[1.0, 1.0]))
    assert check.violated
    (row,) = (x for x in str(check).splitlines() if x.strip().startswith("joint_velocity"))
    shown = float(re.search(r"([\d.]+) s ", row)[1])
    # The time is in the middle between two samples.
    assert abs(shown - check["joint_velocity"].t) < step / 2
    assert 36 <= (shown - origin) / step <= 38


def test_points_of_a_plan_have_any_distance():
    t = without(WHOLE, (0.5, 0.9))
    points = Samples(t=t, q=motion(t), is_plan=True)
    assert ac.check(points, ARM, LIMITS).verdict == "kept"


def test_a_gap_in_a_file_has_its_line():
    t = without(WHOLE, (0.5, 0.9))
    rows = [f"{x:.3f},{a:.9f},{b:.9f}" for x, (a, b) in zip(t, motion(t), strict=True)]
    text = "\n".join(["# recorded", "t,q1,q2", "", *rows, rows[-1]])
    samples = parse_trajectory(text)
    (gap,) = ac.check(samples, ARM, LIMITS).gaps
    assert text.split("\n")[gap.line - 1].startswith("0.500,")
