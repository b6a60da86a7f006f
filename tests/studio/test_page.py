"""What the page computes, run by node: frames, their order, edits on their way, drawing."""

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, compute

from armcontour.frames import Frame as Pose
from armcontour.studio.executed import executed_frame
from armcontour.studio.preview import Previewer
from armcontour.studio.wire import Frame

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
    data = Frame("picture", head, arrays).pack()
    found = compute(
        """
        const { unpack } = await import("./wire.js");
        const frame = unpack(new Uint8Array(given).buffer);
        const arrays = Object.entries(frame.arrays).map(([name, x]) => [name, [...x]]);
        tell({ ...frame, arrays: Object.fromEntries(arrays) });
        """,
        list(data),
    )
    assert (found["kind"], found["seq"], found["rev"]) == ("picture", 7, 2)
    assert found["head"]["sentence"] == head["sentence"]
    for name, values in arrays.items():
        assert found["shapes"][name] == list(values.shape)
        assert found["arrays"][name] == values.ravel().astype(float).tolist()


def test_executions_break_between_contours(paper, view, tmp_path):
    lines = '<path d="M 350 100 L 400 140"/><path d="M 300 250 L 330 290"/>'
    size = 'width="500mm" height="500mm" viewBox="0 0 500 500"'
    drawing = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{lines}</svg>'
    (tmp_path / "two.svg").write_text(drawing)
    previewer = Previewer(tmp_path)
    executed = previewer.execute(previewer.plan({**paper, "path": {"file": "two.svg"}}, "optimal"))
    arrays = executed_frame(executed, view).arrays
    steps = np.linalg.norm(np.diff(arrays["base"], axis=0), axis=1)
    assert arrays["breaks"].tolist() == [0, 1 + steps.argmax()]


STORE = """
const { Store } = await import("./state.js");
const { exactnessOf } = await import("./figures.js");
const store = new Store(), told = [], rest = { arrays: {}, shapes: {}, asked: 0 };
const put = (kind, rev, seq, head = {}) =>
  store.put({ kind, rev, seq, head, ...rest });
const listen = (who, events) => events.forEach((event) =>
  store.on(event, (x) => told.push([who, event, x?.kind ?? x?.stage ?? x?.t])));
"""


def test_no_older_frame_is_shown_after_a_newer_one():
    orders = [(1, 5), (1, 4), (1, 6), (0, 9), (2, 6), (2, None), (1, 8), (2, 7)]
    found = compute(
        f"""{STORE}
        store.on("picture", (x) => told.push([x.rev, x.seq]));
        for (const [rev, seq] of given) put("picture", rev, seq);
        tell(told);
        """,
        orders,
    )
    assert found == [[1, 5], [1, 6], [2, 6], [2, None], [2, 7]]


def test_obstacles_are_drawn_where_their_corners_are():
    random = np.random.default_rng(7)
    turn, at, size = random.uniform(-3, 3, 3), random.normal(size=3), random.uniform(0.1, 1, 3)
    plane = {"origin": [0.1, 0.2, 0.0], "x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]}
    box = {"kind": "boxes", "index": 0, "at": at, "rpy": turn, "size": size}
    outline = compute(
        'const { outlineOf } = await import("./footprint.js"); tell(outlineOf(...given));',
        [box, plane],
    )
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = at + (signs * size) @ Pose.rpy([0, 0, 0], turn).rotation.T
    seen = corners[:, :2] - plane["origin"][:2]
    hull = np.array(outline)
    # Every corner of the outline is one of the box, and no corner of the box is outside of it.
    assert np.linalg.norm(hull[:, None] - seen, axis=2).min(axis=1).max() < 1e-12
    sides = np.roll(hull, -1, axis=0) - hull
    away = seen[:, None] - hull
    assert (sides[:, 0] * away[..., 1] - sides[:, 1] * away[..., 0]).min() > -1e-12
