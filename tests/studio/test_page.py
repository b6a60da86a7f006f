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
    # No error is drawn between them.
    found = compute(
        """
        const { errorsOf } = await import("./motion.js");
        const { t, error } = errorsOf({ arrays: given });
        tell([[...t], [...error]]);
        """,
        {"t": [0, 1, 2, 5, 6], "error": [1, 2, 3, 4, 5], "breaks": [0, 3]},
    )
    assert found == [[0, 1, 2, 3.5, 5, 6], [1, 2, 3, None, 4, 5]]


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


def test_nothing_of_another_job_is_shown_and_nothing_is_exact_without_a_server():
    found = compute(
        f"""{STORE}
        const note = () => told.push([
          ["picture", "executed", "figures"].filter((x) => store.latest(x)),
          store.refusal !== null, exactnessOf(store),
        ]);
        put("document", 1, 1, {{ id: "one" }});
        put("picture", 1, 1);
        put("executed", 1, 1);
        put("figures", 1, 1);
        note();
        store.isOffline = true;
        note();
        store.isOffline = false;
        put("document", 2, 1, {{ id: "one" }});
        note();
        put("refusal", 2, 1, {{ tier: 1 }});
        put("document", 3, 1, {{ id: "two" }});
        note();
        tell(told);
        """
    )
    every = ["picture", "executed", "figures"]
    assert found == [
        [every, False, "exact"],
        [every, False, "not connected"],
        # The figures are of the job before the change.
        [every, False, "preview"],
        [[], False, "not planned yet"],
    ]


def test_what_comes_later_is_told_what_is_there_and_nobody_is_told_twice():
    found = compute(
        f"""{STORE}
        listen("first", ["document", "refusal", "view"]);
        put("document", 1, 1);
        put("picture", 1, 1);
        put("refusal", 1, 1, {{ tier: 1 }});
        store.setCursor({{ t: 2, source: "path" }});
        store.setView({{ stage: "both" }});
        const before = told.splice(0).length;
        store.catchUp(() =>
          listen("later", ["document", "picture", "refusal", "cursor", "view", "pose"]));
        const late = told.splice(0);
        put("document", 1, 1);
        tell([before, late, told]);
        """
    )
    late = [
        *(["document", "document"], ["picture", "picture"]),
        *(["refusal", "refusal"], ["cursor", 2], ["view", "both"]),
    ]
    assert found[:2] == [3, [["later", *x] for x in late]]
    assert found[2] == [[who, "document", "document"] for who in ("first", "later")]


def test_a_refusal_stays_until_a_path_is_had_again_and_one_that_was_dropped_leaves_all():
    refused = [("picture", 1, 1), ("refusal", 2, 1), ("executed", 2, 1), ("picture", 3, 1)]
    dropped = [("picture", 4, 0), ("refusal", 5, 1), ("refusal", 6, 0), ("refusal", 7, 1)]
    found = compute(
        f"""{STORE}
        let said = 0;
        store.on("dropped", () => said++);
        const [refused, dropped] = given;
        tell([
          refused.map(([kind, seq, tier]) => {{
            put(kind, 1, seq, {{ tier }});
            return [store.refusal !== null, store.isCurrent(store.latest("picture"))];
          }}),
          dropped.map(([kind, seq, dropped]) => {{
            put(kind, 1, seq, {{ tier: 1, dropped: Boolean(dropped) }});
            return [store.refusal?.seq ?? null, said];
          }}),
        ]);
        """,
        [refused, dropped],
    )
    assert found[0] == [[False, True], [True, False], [True, False], [False, True]]
    assert found[1] == [[None, 0], [None, 1], [6, 1], [6, 2]]


def test_sliders_come_back_to_where_they_were_and_views_keep_what_is_under_the_pointer():
    sliders = [
        {"min": 1e-5, "max": 2e-2, "log": True, "factor": 1e-3},
        {"min": 1e-3, "max": 2.0, "log": True, "factor": 1.0},
        {"min": 0.0, "max": 0.9, "log": False, "factor": 0.01},
    ]
    positions = [0, 1, 333, 500, 999, 1000]
    given = {"sliders": sliders, "positions": positions, "at": [211, 47]}
    found = compute(
        """
        const { positionOf, valueAt } = await import("./scales.js");
        const { Viewport, boxOf } = await import("./viewport.js");
        const at = (x, k) => [valueAt(x, k), positionOf(x, valueAt(x, k))];
        const rows = given.sliders.map((x) => given.positions.map((k) => at(x, k)));
        const view = new Viewport();
        view.resize({ width: 800, height: 500 });
        view.fit(boxOf(new Float32Array(given.points.flat())));
        const corners = given.points.map((x) => view.toScreen(x));
        const before = view.toPlane(given.at);
        view.zoom(3.7, given.at);
        const back = view.toScreen(view.toPlane([13, 77]));
        tell({ rows, corners, before, after: view.toPlane(given.at), back });
        """,
        {"points": [[-0.1, -0.05], [0.3, 0.15]], **given},
    )
    for slider, rows in zip(sliders, found["rows"], strict=True):
        values = [x for x, _ in rows]
        assert values == sorted(values)
        assert values[0] == pytest.approx(slider["min"]) and values[-1] == slider["max"]
        # Three digits of a logarithmic scale are finer than its positions.
        assert [k for _, k in rows] == pytest.approx(positions, abs=1)
    assert found["after"] == pytest.approx(found["before"], abs=1e-12)
    assert found["back"] == pytest.approx([13, 77])
    for x, y in found["corners"]:
        assert 0 < x < 800 and 0 < y < 500


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


def test_a_drag_follows_the_pointer_before_the_next_frame_where_the_browser_tells():
    found = compute(
        """
        globalThis.window = new EventTarget();
        const moved = (early, dragged) => {
          const moves = [];
          const grip = Object.assign(new EventTarget(), {
            focus() {},
            setPointerCapture() {},
            classList: { add() {}, remove() {} },
          });
          const say = (name, at) =>
            grip.dispatchEvent(Object.assign(new Event(name), { button: 0, at }));
          const move = (event) => moves.push(event.at);
          dragged(grip, { start: () => true, move, end: () => {} });
          say("pointerdown", 0);
          for (const at of [1, 2, 3]) {
            if (early) say("pointerrawupdate", at);
            // A frame of the screen has one of these, which says where the pointer was last.
            if (!early || at === 3) say("pointermove", at);
          }
          say("lostpointercapture");
          say("pointermove", 4);
          say("pointerrawupdate", 4);
          return moves;
        };
        const late = moved(false, (await import("./gesture.js")).dragged);
        globalThis.onpointerrawupdate = null;
        tell([late, moved(true, (await import("./gesture.js?early")).dragged)]);
        """
    )
    assert found == [[1, 2, 3], [1, 2, 3]]


def test_the_newest_edit_goes_at_once_and_only_a_few_wait_for_answers():
    found = compute(
        """
        const sent = [];
        globalThis.location = { hash: "#1", host: "here", pathname: "/" };
        globalThis.history = globalThis.sessionStorage = new Proxy({}, { get: () => () => null });
        globalThis.WebSocket = class {
          static OPEN = 1;
          readyState = 1;
          send(text) { sent.push(JSON.parse(text)); }
        };
        const { Link } = await import("./link.js");
        const link = new Link({ tell: () => {}, put: () => {}, restart: () => {} });
        link.open();
        // What is said right after the greeting goes, too: the server keeps it.
        link.socket.onopen();
        link.send({ op: "diff" });
        const first = sent.splice(0);
        link.seq = 0;
        link.state.state = "open";
        const gesture = link.newGesture(), steps = [];
        const move = (k, final = false) => link.edit([{ to: k }], { gesture, final });
        const answer = (seq) => link.answered({ kind: "picture", seq, head: {} });
        const note = () => steps.push([sent.map((x) => x.edits[0].to), link.state.busy]);
        for (const k of [1, 2, 3, 4, 5]) move(k);
        note();
        answer(2);
        note();
        answer(1);
        move(6);
        move(7);
        note();
        move(8, true);
        note();
        answer(5);
        note();
        answer(6);
        note();
        process.nextTick(() => process.exit());
        tell([first, steps]);
        """
    )
    assert found[0] == [{"op": "hello", "token": "1"}, {"op": "diff", "seq": 1}]
    # Of those that wait the newest replaces the others; the last one of a gesture never waits.
    assert found[1] == [
        [[1, 2, 3], True],
        [[1, 2, 3, 5], True],
        [[1, 2, 3, 5, 6], True],
        [[1, 2, 3, 5, 6, 8], True],
        [[1, 2, 3, 5, 6, 8], True],
        [[1, 2, 3, 5, 6, 8], False],
    ]
