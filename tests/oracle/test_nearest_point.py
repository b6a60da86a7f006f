"""Nearest points against brute force in plain Python, and against dense samples."""

import math

import numpy as np
import pytest

import armcontour as ac


def distance_to_line(p, a, b):
    along = [y - x for x, y in zip(a, b, strict=True)]
    to = [y - x for x, y in zip(a, p, strict=True)]
    share = sum(x * y for x, y in zip(along, to, strict=True)) / sum(x * x for x in along)
    share = min(max(share, 0.0), 1.0)
    return math.dist(p, [x + share * y for x, y in zip(a, along, strict=True)])


def distance_to_arc(p, start, center, normal, angle):
    """By the polar angle about the centre, in the arc's own frame."""
    n = np.asarray(normal) / np.linalg.norm(normal) * np.sign(angle)
    e1 = np.asarray(start) - center
    radius = np.linalg.norm(e1)
    e1 = e1 / radius
    e2 = np.cross(n, e1)
    to = np.asarray(p) - center
    x = float(to @ e1)
    y = float(to @ e2)
    z = float(to @ n)
    if math.atan2(y, x) % (2 * math.pi) <= abs(angle) or math.hypot(x, y) == 0.0:
        return math.hypot(math.hypot(x, y) - radius, z)
    ends = [(radius * math.cos(a), radius * math.sin(a)) for a in (0.0, abs(angle))]
    return min(math.dist((x, y, z), (*end, 0.0)) for end in ends)


def in_space(point):
    return np.array([*point, 0.0]) if len(point) == 2 else np.asarray(point)


def brute_force(segments, p):
    best = math.inf
    for x in segments:
        if isinstance(x, ac.Line):
            best = min(best, distance_to_line(list(p), list(x.start), list(x.end)))
        else:
            normal = (0.0, 0.0, 1.0) if x.normal is None else x.normal
            points = (in_space(y) for y in (p, x.start, x.center))
            best = min(best, distance_to_arc(*points, normal, x.angle))
    return best


def random_chain(rng, dimension, count, lengths):
    """A chain of lines and arcs with corners of any kind between them."""
    end = rng.normal(size=dimension)
    segments = []
    for _ in range(count):
        size = rng.choice(lengths)
        direction = rng.normal(size=dimension)
        direction /= np.linalg.norm(direction)
        if rng.random() < 0.5:
            segments.append(ac.Line(start=end, end=end + size * direction))
        else:
            center = end + size * direction
            angle = rng.choice([-1, 1]) * rng.choice([1e-3, 1.0, 3.0, 5.0, 2 * np.pi])
            normal = None if dimension == 2 else np.cross(direction, rng.normal(size=3))
            segments.append(ac.Arc(start=end, center=center, angle=angle, normal=normal))
        end = ac.Path(segments=segments[-1:]).vertices[-1]
    return segments


def assert_nearest(segments, queries, atol):
    path = ac.Path(segments=segments)
    projection = path.project(queries)
    expected = [brute_force(segments, p) for p in queries]
    np.testing.assert_allclose(projection.distance, expected, rtol=1e-12, atol=atol)
    # The place it names is at the distance it names.
    named = np.linalg.norm(path(np.clip(projection.s, 0, path.length)) - queries, axis=1)
    np.testing.assert_allclose(named, projection.distance, rtol=1e-9, atol=10 * atol)
    # And no sample of the path is nearer.
    samples = path(np.linspace(0, path.length, 4001))
    sampled = np.array([np.linalg.norm(samples - p, axis=1).min() for p in queries[:50]])
    assert (projection.distance[:50] <= sampled * (1 + 1e-12) + atol).all()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [1, 3, 12, 60])
def test_nearest_points_on_lines_and_arcs_equal_those_of_the_oracle(dimension, count):
    rng = np.random.default_rng(10 * count + dimension)
    segments = random_chain(rng, dimension, count, [0.1, 1.0])
    path = ac.Path(segments=segments)
    near = path(rng.random(60) * path.length) + 0.01 * rng.normal(size=(60, dimension))
    far = 5 * rng.normal(size=(60, dimension))
    assert_nearest(segments, np.concatenate([near, far, path.vertices]), 1e-13)


@pytest.mark.parametrize("dimension", [2, 3])
def test_nearest_points_among_micro_segments_equal_those_of_the_oracle(dimension):
    rng = np.random.default_rng(dimension)
    segments = random_chain(rng, dimension, 60, [1e-7, 1e-6, 1e-5, 1.0])
    path = ac.Path(segments=segments)
    points = path(rng.random(100) * path.length)
    assert_nearest(segments, points + 1e-6 * rng.normal(size=points.shape), 1e-13)


@pytest.mark.parametrize("radius", [1e3, 1e6])
def test_nearest_points_on_a_very_large_arc_equal_those_of_the_oracle(radius):
    rng = np.random.default_rng(5)
    arc = ac.Arc(start=(0, 0), center=(0, radius), angle=1.0 / radius)
    queries = np.stack([rng.uniform(-0.5, 1.5, 200), 0.2 * rng.normal(size=200)], axis=1)
    # The oracle measures from the far centre and loses digits there; the path must not.
    assert_nearest([arc], queries, 4e-16 * radius)
    path = ac.Path(segments=[arc])
    on = path(np.linspace(0, 1, 101))
    np.testing.assert_allclose(path.project(on).distance, 0, atol=4e-16)


@pytest.mark.parametrize("dimension", [2, 3])
def test_distances_from_arc_centres_equal_those_of_the_oracle(dimension):
    rng = np.random.default_rng(6)
    arcs = [x for x in random_chain(rng, dimension, 20, [0.1, 1.0]) if isinstance(x, ac.Arc)]
    for arc in arcs:
        offsets = [np.zeros((1, dimension)), 1e-9 * rng.normal(size=(20, dimension))]
        assert_nearest([arc], np.asarray(arc.center) + np.concatenate(offsets), 1e-13)


def test_nearest_points_on_a_long_winding_path_equal_those_of_the_oracle():
    rng = np.random.default_rng(7)
    points = np.cumsum(rng.normal(size=(3000, 2)), axis=0)
    path = ac.Path.polyline(points)
    queries = points.mean(axis=0) + 30 * rng.normal(size=(300, 2))
    a = points[:-1]
    way = np.diff(points, axis=0)
    share = np.einsum("qsd,sd->qs", queries[:, None] - a, way) / (way**2).sum(axis=1)
    nearest = a + np.clip(share, 0, 1)[..., None] * way
    expected = np.linalg.norm(queries[:, None] - nearest, axis=2).min(axis=1)
    np.testing.assert_allclose(path.project(queries).distance, expected, rtol=1e-12, atol=1e-13)
