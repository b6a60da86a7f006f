"""Shapes that the page measures: those of the server's segments, and their distances."""

import math

import numpy as np
import pytest
from tests.studio.session_pages import SessionPage, session_of
from tests.studio.test_arithmetic import NODE, compute

from armcontour.files import parse_job
from armcontour.studio.segments_frame import segments_frame

JOB = """
name: a
arm: {name: ur5e, work: {position: [0.4, 0, 0.2]}}
path:
  start: [0, 0, 0.01]
  segments:
    - {to: [0.03, 0, 0.01]}
    - {via: [0.04, 0.01, 0.01], to: [0.03, 0.02, 0.01]}
    - {via: [0.02, 0.03, 0.01], to: [0.03, 0.04, 0.01]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.1}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
cycle: 4 ms
runs: {own: {}}
"""
MEASURE = """
const { circleShape, circleThrough, lineShape } = await import("./shapes.js");
const { measure, pointShape, shapesOfSegments } = await import("./shapes.js");
"""


def test_segments_of_the_drawing_are_sent_in_the_work_frame():
    frame = segments_frame(parse_job(JOB).program)
    assert frame.header["count"] == 3
    arrays = frame.arrays
    np.testing.assert_allclose(arrays["starts"][0], [0, 0, 0.01], atol=1e-15)
    np.testing.assert_allclose(arrays["ends"][-1], [0.03, 0.04, 0.01], atol=1e-12)
    np.testing.assert_allclose(arrays["curvatures"], [0, 100, 100], atol=1e-9)
    np.testing.assert_allclose(arrays["lengths"], [0.03, math.pi / 100, math.pi / 100])
    assert segments_frame(None).header["count"] == 0


def test_page_gets_the_segments_that_it_asks_for(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    page = SessionPage(session_of(file))
    (frame,) = (x for x in page.say("segments") if x.kind == "segments")
    assert frame.header["count"] == 3 and frame.arrays["lengths"].dtype == np.float64


node = pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")


@node
def test_arcs_that_continue_each_other_are_one_circle():
    # A circle as two half circles, then one that turns the other way.
    rows = [((1, 0, 0), (0, 1, 0), (-1, 0, 0)), ((-1, 0, 0), (0, -1, 0), (1, 0, 0)),
            ((1, 0, 0), (0, 1, 0), (1, 0, 0))]  # fmt: skip
    starts, tangents, normals = (np.ravel([x[k] for x in rows]).tolist() for k in range(3))
    given = {"starts": starts, "ends": starts, "tangents": tangents, "normals": normals}
    given |= {"curvatures": [1, 1, 1], "lengths": [math.pi] * 3}
    found = compute(
        MEASURE
        + """
        const arrays = {};
        for (const [name, x] of Object.entries(given)) arrays[name] = Float64Array.from(x);
        const shapes = shapesOfSegments(arrays, 3);
        tell(shapes.map(({ kind, radius, centre, length }) => [kind, radius, centre, length]));
        """,
        given,
    )
    assert [x[:2] for x in found] == [["circle", 1], ["arc", 1]]
    np.testing.assert_allclose([x[2] for x in found], [[0, 0, 0], [2, 0, 0]], atol=1e-12)
    np.testing.assert_allclose([x[3] for x in found], [2 * math.pi, math.pi])


@node
def test_distance_of_two_lines_is_the_smallest_one():
    random = np.random.default_rng(5)
    lines = random.normal(size=(60, 4, 3))
    lines[0] = [[0, 0, 0], [1, 0, 0], [0.2, 1, 0], [3, 1, 0]]
    found = compute(
        MEASURE
        + """
        tell(given.map(([a, b, c, d]) => measure(lineShape(a, b), lineShape(c, d))));
        """,
        lines.tolist(),
    )
    share = np.linspace(0, 1, 201)[:, None]
    for (a, b, c, d), x in zip(lines, found, strict=True):
        first = a + share * (b - a)
        second = c + share * (d - c)
        sampled = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        assert x["distance"] <= sampled + 1e-12
        assert x["distance"] == pytest.approx(sampled, abs=0.02)
        p, q = np.array(x["ends"])
        assert np.linalg.norm(q - p) == pytest.approx(x["distance"], abs=1e-12)
        np.testing.assert_allclose(x["components"], q - p, atol=1e-12)
        u = (b - a) / np.linalg.norm(b - a)
        v = (d - c) / np.linalg.norm(d - c)
        assert x["angle"] == pytest.approx(math.acos(min(1.0, abs(u @ v))), abs=1e-6)


@node
def test_circles_are_measured_from_their_centres():
    centre, radius, direct = compute(
        MEASURE
        + """
        const circle = circleShape([1, 2, 3], [0, 0, 1], 0.5);
        const other = circleShape([1, 2, 7], [0, 1, 0], 0.1);
        const through = circleThrough(circle.points[0], circle.points[9], circle.points[30]);
        tell([measure(circle, other), through, measure(circle, pointShape([4, 6, 3]))]);
        """
    )
    assert centre["distance"] == pytest.approx(4) and centre["fromCentres"] == 2
    assert centre["angle"] == pytest.approx(math.pi / 2)
    assert radius["radius"] == pytest.approx(0.5)
    np.testing.assert_allclose(radius["centre"], [1, 2, 3], atol=1e-12)
    assert direct["distance"] == pytest.approx(5) and direct["angle"] is None


@node
def test_typed_values_have_units():
    values = compute(
        """
        globalThis.document = { querySelector: () => null };
        const { readTyped } = await import("./placing.js");
        const lengths = { mm: 1e-3, cm: 1e-2, m: 1, in: 0.0254 };
        const texts = ["12.5", "12,5 mm", "-1 in", "0.2 m", "12 deg", "far", "", "1 2"];
        tell(texts.map((text) => readTyped(text, lengths)));
        """
    )
    assert values[:4] == [0.0125, 0.0125, -0.0254, 0.2]
    assert values[4:] == [None] * 4
