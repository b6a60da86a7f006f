"""Path points of a tool that follows a path that crosses itself."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.verification.error_profile import follow_path

OFF = 0.3e-3


def retraced(random):
    """A path of lines and arcs that crosses itself, turns back and is run again in parts."""
    points = [random.uniform(0, 0.1, 2)]
    segments = []
    while len(segments) < 14:
        kind = random.integers(4)
        if kind == 0 and len(points) > 2:
            points += points[-2::-1][: random.integers(1, len(points))]  # back the same way
        elif kind == 1 and len(points) > 3:
            points += [points[-3], points[-2], points[-1]]  # another lap
        else:
            points.append(random.uniform(0, 0.1, 2))
        segments = points[1:]
    path = ac.Path.polyline(np.array(points[:15]))
    if random.integers(2):
        path = ac.round_corners(path, tolerance=random.uniform(0.1e-3, 1e-3))
    return path


def moved(path, random, n=3000, cut=0.0):
    """Tool points near a path, and their true places; tips of it may be cut off."""
    s = np.unique(np.concatenate([np.linspace(0, path.length, n), path.breaks]))
    for stop in path.stops if cut else []:
        s = s[np.abs(s - stop) > random.uniform(0.2, 1) * cut]
    s[[0, -1]] = 0, path.length
    middle = path(s)
    phase = random.uniform(0, 6, 2)
    wave = random.uniform(100, 300, 2)
    return middle + OFF / 2 * np.sin(wave * s[:, None] + phase), s


def near(path, tool, s, window):
    """Distance of every tool point from the places within a window around its true place."""
    best = np.full(len(tool), np.inf)
    for k in range(len(path)):
        low = np.maximum(s - window, path.breaks[k])
        high = np.minimum(s + window, path.breaks[k + 1])
        inside = low <= high
        low = low[inside]
        high = high[inside]
        points = tool[inside]
        if not len(points):
            continue
        for _ in range(4):
            u = np.minimum(
                low[:, None] + np.linspace(0, 1, 25) * (high - low)[:, None], path.length
            )
            distances = np.linalg.norm(path(u.ravel()).reshape(-1, 25, 2) - points[:, None], axis=2)
            i = distances.argmin(axis=1)
            rows = np.arange(len(u))
            best[inside] = np.minimum(best[inside], distances.min(axis=1))
            low = u[rows, np.maximum(i - 1, 0)]
            high = u[rows, np.minimum(i + 1, 24)]
    return best


def left_out(path, tool, s, window):
    """Largest distance from the path to the tool near the true places."""
    places = np.union1d(np.linspace(0, path.length, 4000), path.breaks)
    fine = np.linspace(0, len(tool) - 1, 40 * len(tool))
    tool = np.stack([np.interp(fine, np.arange(len(tool)), x) for x in tool.T], axis=1)
    s = np.interp(fine, np.arange(len(s)), s)
    first = np.searchsorted(s, places - window)
    last = np.searchsorted(s, places + window)
    worst = 0.0
    for x, i, j in zip(path(places), first, last, strict=True):
        worst = max(worst, np.linalg.norm(tool[max(i - 1, 0) : j + 1] - x, axis=1).min())
    return worst


def judge_places(seed):
    """Places that are found, against brute force."""
    random = np.random.default_rng([61, seed])
    path = retraced(random)
    cut = 1e-3 * (seed % 2)
    tool, s = moved(path, random, cut=cut)
    matching = follow_path(path, tool)
    # No place is nearer around the true one, and none that is far from there is taken.
    size = OFF + cut
    assert (matching.distance <= near(path, tool, s, OFF) + 1e-9).all()
    assert (matching.distance >= near(path, tool, s, 20 * size) - 1e-6).all()
    assert np.abs(matching.s - s).max() <= 20 * size
    coverage_error = left_out(path, tool, s, 3 * size)
    assert max(matching.coverage_error.max(), 0.0) == pytest.approx(coverage_error, abs=1e-5)


def test_nearest_points_advance_along_the_path_with_the_motion():
    for seed in range(4):  # tests/slow has more
        judge_places(seed)


def test_the_coverage_error_is_exact_if_one_step_passes_a_long_stretch():
    for seed in range(40):
        random = np.random.default_rng(seed)
        path = ac.Path.polyline(np.cumsum(random.uniform(0, [0.003, 0.002], (6, 2)), axis=0))
        if seed % 2:
            path = ac.round_corners(path, tolerance=random.uniform(1e-5, 2e-4))
        tool = np.array([path(0.0), path(path.length)])
        tool[:, 1] += random.uniform(-1e-4, 1e-4, 2)
        tool = np.insert(tool, 1, tool[0] + random.uniform(0.3, 0.7) * (tool[1] - tool[0]), axis=0)
        tool[1, 1] += random.uniform(-4e-3, 4e-3)
        s = np.linspace(0, path.length, 20_001)
        best = np.full(len(s), np.inf)
        for a, b in zip(tool[:-1], tool[1:], strict=True):
            share = np.clip((path(s) - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            best = np.minimum(best, np.linalg.norm(path(s) - a - share[:, None] * (b - a), axis=1))
        # Between two places of the grid the distance is larger by at most half of their distance.
        more = follow_path(path, tool).coverage_error.max() - best.max()
        assert -1e-10 <= more <= s[1] / 2, seed


SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def run(arm, path, limits, method="none", objective=None, resolution=1e-3):
    planned = ac.plan(path, arm, limits)
    set_points = ac.compensate(planned, SERVO, COMPENSATIONS[method](), cycle=4e-3)
    executed = ac.simulate(set_points, ac.ServoPlant(arm, SERVO, limits), resolution=resolution)
    return planned, executed, ac.evaluate(executed, path, objective=objective, limits=limits)


@pytest.mark.parametrize("method", ["none", "pole_placement"])
def test_a_tip_that_the_tool_does_not_reach_causes_coverage_error(arm, method):
    path = ac.Path.polyline([(0.30, 0.2), (0.36, 0.2), (0.30, 0.2)])
    limits = arm.limits.replace(speed=0.15, joint_acceleration=3.0)
    _, executed, result = run(arm, path, limits, method, path)
    finer = ac.simulate(executed.set_points, executed.plant, resolution=1e-5)
    tip = np.linalg.norm(finer.tool - [0.36, 0.2], axis=1)
    assert result.coverage_error.max == pytest.approx(tip.min(), rel=1e-6)
    assert result.coverage_error.s_max == pytest.approx(0.06, abs=1e-9)
    assert abs(result.coverage_error.t_max - finer.t[tip.argmin()]) < 0.02
    # The other direction does not show it.
    assert result.contour_error.max < tip.min() / 5
    assert result.corners[0].rounding == pytest.approx(tip.min(), rel=1e-6)
