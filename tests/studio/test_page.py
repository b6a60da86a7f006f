"""Computations of the page, run by node: frames, their order, and drawing."""

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, compute

from armcontour.report.message_frame import MessageFrame

pytestmark = pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")


def test_the_page_reads_the_frames_that_the_server_writes():
    random = np.random.default_rng(3)
    arrays = {
        "path": random.normal(size=(5, 2)).astype(np.float32),
        "binding": np.array([0, 255, 3], dtype=np.uint8),
        "q": random.normal(size=(2, 3)),
        "breaks": np.array([1, 70000], dtype=np.uint32),
        "none": np.empty((0, 2), dtype=np.float32),
    }
    head = {"seq": 7, "rev": 2, "sentence": "a μ of 1° — „done“"}
    data = MessageFrame("picture", head, arrays).pack()
    computed = compute(
        """
        const { unpack } = await import("./message_frame.js");
        const frame = unpack(new Uint8Array(given).buffer);
        const arrays = Object.entries(frame.arrays).map(([name, x]) => [name, [...x]]);
        tell({ ...frame, arrays: Object.fromEntries(arrays) });
        """,
        list(data),
    )
    assert (computed["kind"], computed["seq"], computed["rev"]) == ("picture", 7, 2)
    assert computed["head"]["sentence"] == head["sentence"]
    for name, values in arrays.items():
        assert computed["arrays"][name] == values.ravel().astype(float).tolist()


STORE = """
const { Store } = await import("./state.js");
const store = new Store(), told = [], rest = { arrays: {}, asked: 0 };
const put = (kind, rev, seq, head = {}) =>
  store.put({ kind, rev, seq, head, ...rest });
"""


def test_no_older_frame_is_shown_after_a_newer_one():
    orders = [(1, 5), (1, 4), (1, 6), (0, 9), (2, 6), (2, None), (1, 8), (2, 7)]
    values = compute(
        f"""{STORE}
        store.on("picture", (x) => told.push([x.rev, x.seq]));
        for (const [rev, seq] of given) put("picture", rev, seq);
        tell(told);
        """,
        orders,
    )
    assert values == [[1, 5], [1, 6], [2, 6], [2, None], [2, 7]]


def test_rounded_zeros_are_shown_without_a_sign():
    values = compute(
        """
        const { fixed, difference } = await import("./format.js");
        const of = (text) => ({ text, unit: "mm" });
        tell([fixed(-4e-4, 3), fixed(-4e-2, 3), difference(of("0.1"), of("0.1004"))]);
        """
    )
    assert values == ["0.000", "−0.040", "0.000 mm"]


def test_displayed_difference_has_as_many_digits_as_the_more_precise_figure():
    values = compute(
        """
        const { difference } = await import("./format.js");
        const of = (text) => ({ text, unit: "s" });
        tell([difference(of("17"), of("16.7")), difference(of("9.97"), of("10.2"))]);
        """
    )
    assert values == ["+0.3 s", "−0.2 s"]


def test_path_part_under_pointer_is_nearest_one():
    random = np.random.default_rng(11)
    lines = [random.normal(size=(1, 2)) + 0.1 * random.normal(size=(9, 2)) for _ in range(40)]
    points = np.concatenate(lines)
    starts = np.arange(0, 360, 9)
    at = random.normal(size=(200, 2)) * 1.5
    found = compute(
        """
        const { PieceGrid } = await import("./polylines.js");
        const grid = new PieceGrid(Float64Array.from(given[0].flat()), new Set(given[1]));
        tell(given[2].map(([u, v]) => [0.05, 10].map((near) => grid.nearest(u, v, near))));
        """,
        [points, starts, at],
    )
    begin = points[:-1]
    way = np.diff(points, axis=0)
    share = np.einsum("qij,ij->qi", at[:, None] - begin, way) / np.sum(way**2, axis=1)
    on = begin + np.clip(share, 0.0, 1.0)[..., None] * way
    distance = np.linalg.norm(at[:, None] - on, axis=2)
    distance[:, starts[1:] - 1] = np.inf
    near = distance.min(axis=1) < 0.05
    assert near.any() and not near.all()
    # Two pieces are equally near where they meet, except for rounding.
    rows = np.arange(len(at))
    close, any_piece = np.array(found).T
    np.testing.assert_allclose(distance[rows, any_piece], distance.min(axis=1), rtol=1e-12)
    np.testing.assert_array_equal(close, np.where(near, any_piece, -1))


NUMBERS = """
const { placeNumbers } = await import("./contour_numbers.js");
const { Viewport } = await import("./viewport.js");
const view = new Viewport();
view.resize({ width: given.width, height: 800 });
view.scale = given.scale;
const marks = given.starts.map(([u, v], k) => ({
  at: [u, v], out: [1, 0], centre: [u - given.radius, v], size: 2 * given.radius,
  number: String(k + 1),
}));
tell(placeNumbers(marks, view, given.selected));
"""


# Contours of 2.4 and 8 px would be covered by numbers of 7 to 21 px.
@pytest.mark.parametrize(
    ("scale", "least", "most"), [(300.0, 1, 2), (1000.0, 4, 12), (4000.0, 120, 120)]
)
def test_numbers_of_contours_neither_overlap_nor_cover_small_contours(scale, least, most):
    # Rows of contours of 8 mm, 12 mm apart.
    starts = [[0.012 * (k % 12 - 6), 0.012 * (k // 12 - 5)] for k in range(120)]
    given = {"starts": starts, "radius": 0.004, "scale": scale, "width": 1200, "selected": 77}
    placed = compute(NUMBERS, given)
    assert placed[0]["number"] == "78"
    assert least <= len(placed) <= most
    for k, a in enumerate(placed):
        for b in placed[k + 1 :]:
            # A digit of this font is 6 px wide and 11 px high.
            across = 6 * (len(a["number"]) + len(b["number"])) / 2
            assert abs(a["x"] - b["x"]) >= across or abs(a["y"] - b["y"]) >= 11
    assert len({x["number"] for x in placed}) == len(placed)


UNITS = """
const units = await import("./units.js");
units.inches.value = given.inches;
tell(given.calls.map(([name, ...options]) => units[name](...options)));
"""


def test_lengths_are_shown_in_inches_on_demand():
    row = {"name": "duration", "value": 1, "text": "25.4", "unit": "mm", "note": "2.54 mm wide"}
    calls = [
        ["shownText", "at 254 mm/s, 0.0254 m and 50 mm²; 5 mm"],
        ["shownText", "no length in 3 s or 2 min"],
        ["shownRow", row],
        ["shownRow", {**row, "unit": "s"}],
        ["shownField", "420 mm, -20 mm, 100 mm", "m"],
        ["shownField", "50 mm/s", "mm/s"],
        ["shownField", "0.0254", "m"],
        ["shownField", "auto", "m"],
        ["typedField", "2", "mm/s"],
        ["typedField", "2 mm", "m"],
        ["typedField", "1, 2", "m"],
        ["typedField", "2", "1/s"],
        ["shownUnit", "mm/s"],
        ["shownText", "< 0.001 mm"],
        ["lengthText", 0.0254],
    ]
    metric = compute(UNITS, {"inches": False, "calls": calls})
    same = [calls[0][1], calls[1][1], row, {**row, "unit": "s"}]
    assert metric == [*same, *(x[1] for x in calls[4:-1]), "25.400 mm"]
    shown = compute(UNITS, {"inches": True, "calls": calls})
    assert shown[0] == "at 10 in/s, 1 in and 50 mm²; 0.197 in"
    assert shown[1] == calls[1][1]
    assert shown[2] == {**row, "text": "1", "unit": "in", "note": "0.1 in wide"}
    assert shown[3]["text"] == "25.4" and shown[3]["value"] == 1
    position = [float(x.removesuffix(" in")) * 25.4 for x in shown[4].split(", ")]
    assert position == pytest.approx([420, -20, 100], rel=1e-4)
    assert shown[5] == "1.9685 in/s" and shown[6] == "1" and shown[7] == "auto"
    # A bound has no more digits than before.
    assert shown[8:] == [
        *("2 in/s", "2 mm", "1 in, 2 in", "2", "in/s", "< 0.00004 in"),
        "1.0000 in",
    ]
