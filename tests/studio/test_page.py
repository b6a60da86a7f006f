"""The page: its files fit together, ask for nothing from elsewhere, and compute rightly."""

import re
import struct

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, STATIC, compute

from armcontour.frames import Frame as Pose
from armcontour.studio.executed import executed_frame
from armcontour.studio.preview import Previewer
from armcontour.studio.wire import Frame

with_node = pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")
OWN = {x.name: x.read_text() for x in sorted(STATIC.glob("*.*"))}
MODULES = {name: text for name, text in OWN.items() if name.endswith(".js")}
PAGE = OWN["index.html"]
SLIDERS = [
    {"min": 1e-5, "max": 2e-2, "log": True, "factor": 1e-3},
    {"min": 1e-3, "max": 2.0, "log": True, "factor": 1.0},
    {"min": 0.0, "max": 0.9, "log": False, "factor": 0.01},
]


def _asked(text: str, later: bool) -> set[str]:
    """Modules that a module asks for, also those that it loads later."""
    found = set(re.findall(r'from "\./([\w./]+)"', text))
    return found | set(re.findall(r'await import\("\./([\w./]+)"\)', text)) if later else found


def _reached(*, later: bool) -> set[str]:
    """All modules that the page's first one leads to."""
    used, rest = set(), ["app.js"]
    while rest:
        name = rest.pop()
        used.add(name)
        rest += _asked(MODULES.get(name, ""), later) - used
    return used


def test_every_module_that_is_asked_for_is_there_and_every_other_one_too():
    used = _reached(later=True)
    own = {x for x in used if not x.startswith("vendor/")}
    assert own == set(MODULES)
    assert all((STATIC / x).is_file() for x in used)


def test_the_page_names_all_modules_that_it_begins_with_so_that_they_are_loaded_at_once():
    named = re.findall(r'<link rel="modulepreload" href="/static/([\w./]+)">', PAGE)
    assert sorted({*named, "app.js"}) == sorted(_reached(later=False))
    assert len(named) == len(set(named))
    # What shows a plan is loaded after it, what draws the arm by WebGL when the arm is first seen.
    assert not {"rest.js", "arm3d.js", "charts.js", "tasks.js"} & set(named)
    assert not {"vendor/three.js", "vendor/uplot.js"} & set(named)


def test_the_page_asks_for_nothing_that_its_policy_forbids():
    assert set(re.findall(r"<script[^>]*>(.*?)</script>", PAGE, re.DOTALL)) == {""}
    assert not re.findall(r"<style|\sstyle=|\son\w+=", PAGE)
    links = re.findall(r'(?:src|href)="([^"]+)"', PAGE)
    assert all(x.startswith(("/static/", "#", "data:")) for x in links)
    for name, text in OWN.items():
        elsewhere = set(re.findall(r"https?://[^\s\"'`)]+", text)) - {"http://www.w3.org/2000/svg"}
        assert not elsewhere, name
        assert not re.findall(r"innerHTML|outerHTML|insertAdjacentHTML|\beval\(", text), name


def test_what_modules_look_for_is_on_the_page():
    there = set(re.findall(r'\sid="([\w-]+)"', PAGE + "".join(MODULES.values())))
    there |= set(re.findall(r'\bid: "([\w-]+)"', "".join(MODULES.values())))
    for name, text in MODULES.items():
        wanted = set(re.findall(r'find\("#([\w-]+)"', text))
        assert wanted <= there, name


@with_node
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
    assert struct.unpack_from("<I", data)[0] > 0
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


def test_lines_of_executions_break_between_contours(paper, view, tmp_path):
    lines = '<path d="M 350 100 L 400 140"/><path d="M 300 250 L 330 290"/>'
    size = 'width="500mm" height="500mm" viewBox="0 0 500 500"'
    drawing = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{lines}</svg>'
    (tmp_path / "two.svg").write_text(drawing)
    previewer = Previewer(tmp_path)
    executed = previewer.execute(previewer.plan({**paper, "path": {"file": "two.svg"}}, "optimal"))
    arrays = executed_frame(executed, view).arrays
    steps = np.linalg.norm(np.diff(arrays["base"], axis=0), axis=1)
    assert arrays["breaks"].tolist() == [0, 1 + steps.argmax()]


@with_node
def test_no_error_is_drawn_between_contours():
    found = compute(
        """
        const { errorsOf } = await import("./motion.js");
        const { t, error } = errorsOf({ arrays: given });
        tell([[...t], [...error]]);
        """,
        {"t": [0, 1, 2, 5, 6], "error": [1, 2, 3, 4, 5], "breaks": [0, 3]},
    )
    assert found == [[0, 1, 2, 3.5, 5, 6], [1, 2, 3, None, 4, 5]]


@with_node
def test_no_older_frame_is_shown_after_a_newer_one():
    orders = [(1, 5), (1, 4), (1, 6), (0, 9), (2, 6), (2, None), (1, 8), (2, 7)]
    found = compute(
        """
        const { Store } = await import("./state.js");
        const store = new Store(), shown = [], rest = { arrays: {}, shapes: {}, asked: 0 };
        store.on("picture", (x) => shown.push([x.rev, x.seq]));
        for (const [rev, seq] of given) {
          store.put({ kind: "picture", rev, seq, head: { of: "live" }, ...rest });
        }
        tell(shown);
        """,
        orders,
    )
    assert found == [[1, 5], [1, 6], [2, 6], [2, None], [2, 7]]


@with_node
def test_nothing_of_another_job_is_shown_and_nothing_is_exact_without_a_server():
    found = compute(
        """
        const { Store } = await import("./state.js");
        const { exactnessOf } = await import("./figures.js");
        const store = new Store(), found = [], rest = { seq: 1, arrays: {}, shapes: {}, asked: 0 };
        const put = (kind, rev, head = {}) =>
          store.put({ kind, rev, head: { of: "live", ...head }, ...rest });
        const note = () => found.push([
          ["picture", "executed", "figures"].filter((x) => store.latest(x)),
          Boolean(store.latest("picture", "compare")), store.refusal !== null, exactnessOf(store),
        ]);
        put("document", 1, { id: "one", compare: { run: "x" } });
        put("picture", 1);
        put("picture", 1, { of: "compare" });
        put("executed", 1);
        put("figures", 1);
        note();
        store.isOffline = true;
        note();
        store.isOffline = false;
        put("document", 2, { id: "one", compare: { run: "x" } });
        note();
        put("refusal", 2, { tier: 1 });
        put("document", 3, { id: "two" });
        note();
        tell(found);
        """,
        [],
    )
    every = ["picture", "executed", "figures"]
    assert found == [
        [every, True, False, "exact"],
        [every, True, False, "not connected"],
        # The figures are of the job before the change.
        [every, True, False, "preview"],
        [[], False, False, "not planned yet"],
    ]


@with_node
def test_what_comes_later_is_told_what_is_there_and_nobody_is_told_twice():
    found = compute(
        """
        const { Store } = await import("./state.js");
        const store = new Store(), told = [], rest = { arrays: {}, shapes: {}, asked: 0 };
        const put = (kind, head = {}) => store.put({ kind, rev: 1, seq: 1, head, ...rest });
        const listen = (who, events) => events.forEach((event) =>
          store.on(event, (x) => told.push([who, event, x?.kind ?? x?.stage ?? x?.t])));
        listen("first", ["document", "refusal", "view"]);
        put("document", { compare: { run: "x" } });
        put("picture");
        put("picture", { of: "compare" });
        put("refusal", { tier: 1 });
        store.setCursor({ t: 2, source: "path" });
        store.setView({ stage: "both" });
        const before = told.splice(0).length;
        store.catchUp(() =>
          listen("later", ["document", "picture", "compare", "refusal", "cursor", "view", "pose"]));
        const late = told.splice(0);
        put("document", { compare: { run: "x" } });
        tell([before, late, told]);
        """,
        [],
    )
    late = [
        ["document", "document"],
        ["picture", "picture"],
        ["compare", "picture"],
        ["refusal", "refusal"],
        ["cursor", 2],
        ["view", "both"],
    ]
    assert found[:2] == [3, [["later", *x] for x in late]]
    assert found[2] == [[who, "document", "document"] for who in ("first", "later")]


@with_node
def test_a_refusal_stays_until_a_path_is_had_again():
    kinds = [("picture", 1, 1), ("refusal", 2, 1), ("executed", 2, 1), ("picture", 3, 1)]
    found = compute(
        """
        const { Store } = await import("./state.js");
        const store = new Store(), rest = { arrays: {}, shapes: {}, asked: 0 };
        tell(given.map(([kind, seq, tier]) => {
          store.put({ kind, rev: 1, seq, head: { of: "live", tier }, ...rest });
          return [store.refusal !== null, store.isCurrent(store.latest("picture"))];
        }));
        """,
        kinds,
    )
    assert found == [[False, True], [True, False], [True, False], [False, True]]


@with_node
def test_an_edit_that_was_not_made_leaves_what_is_shown(tmp_path):
    kinds = [
        ("picture", 1, False),
        ("refusal", 2, True),
        ("refusal", 3, False),
        ("refusal", 4, True),
    ]
    found = compute(
        """
        const { Store } = await import("./state.js");
        const store = new Store(), rest = { arrays: {}, shapes: {}, asked: 0 };
        let said = 0;
        store.on("dropped", () => said++);
        tell(given.map(([kind, seq, dropped]) => {
          store.put({ kind, rev: 1, seq, head: { of: "live", tier: 1, dropped }, ...rest });
          return [store.refusal?.seq ?? null, said];
        }));
        """,
        kinds,
    )
    assert found == [[None, 0], [None, 1], [3, 1], [3, 2]]


@with_node
def test_sliders_give_their_ends_and_come_back_to_where_they_were():
    found = compute(
        """
        const { positionOf, valueAt } = await import("./scales.js");
        const positions = [0, 1, 333, 500, 999, 1000];
        tell(given.map((x) => positions.map((k) => [valueAt(x, k), positionOf(x, valueAt(x, k))])));
        """,
        SLIDERS,
    )
    for slider, rows in zip(SLIDERS, found, strict=True):
        values = [x for x, _ in rows]
        assert values == sorted(values)
        assert values[0] == pytest.approx(slider["min"]) and values[-1] == slider["max"]
        # Three digits of a logarithmic scale are finer than its positions.
        assert [k for _, k in rows] == pytest.approx([0, 1, 333, 500, 999, 1000], abs=1)


@with_node
def test_zooming_keeps_the_place_under_the_pointer_and_fitting_shows_all():
    found = compute(
        """
        const { Viewport, boxOf } = await import("./viewport.js");
        const view = new Viewport();
        view.resize({ width: 800, height: 500 });
        view.fit(boxOf(new Float32Array(given.points.flat())));
        const corners = given.points.map((x) => view.toScreen(x));
        const before = view.toPlane(given.at);
        view.zoom(3.7, given.at);
        const back = view.toScreen(view.toPlane([13, 77]));
        tell({ corners, before, after: view.toPlane(given.at), back });
        """,
        {"points": [[-0.1, -0.05], [0.3, 0.15]], "at": [211, 47]},
    )
    assert found["after"] == pytest.approx(found["before"], abs=1e-12)
    assert found["back"] == pytest.approx([13, 77])
    for x, y in found["corners"]:
        assert 0 < x < 800 and 0 < y < 500


@with_node
def test_names_of_limits_are_not_under_the_handles_of_corners():
    # A path to the right turns left over the name's place; its waypoint is below it.
    corner = {"apex": [0.0, 0.01], "corner": [0.0, 0.0], "allowed": 0.01, "error": 0.01}
    found = compute(
        """
        const { besideHandles, beyond, handledOf } = await import("./corner.js");
        const { rounded, bare } = given;
        const [handled] = handledOf({ head: { corners: [bare, rounded] } });
        const handle = beyond(handled, [50, 40]);
        tell([
          handle,
          besideHandles([50, 40], [0, 1], []),
          besideHandles([50, 40], [0, 1], [handle]),
          besideHandles([50, 40], [0, 1], [handle, [50, 53]]),
        ]);
        """,
        {"rounded": corner, "bare": {**corner, "allowed": None}},
    )
    assert found == [[50, 20], [50, 27], [50, 53], [50, 74]]


@with_node
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


@with_node
@pytest.mark.parametrize("early", [True, False])
def test_a_drag_follows_the_pointer_before_the_next_frame_where_the_browser_tells(early):
    found = compute(
        """
        const moves = [];
        globalThis.window = new EventTarget();
        if (given) globalThis.onpointerrawupdate = null;
        const { dragged } = await import("./gesture.js");
        const grip = Object.assign(new EventTarget(), {
          focus() {},
          setPointerCapture() {},
          classList: { add() {}, remove() {} },
        });
        const say = (name, at) => {
          const event = Object.assign(new Event(name), { button: 0, at });
          grip.dispatchEvent(event);
        };
        dragged(grip, { start: () => true, move: (event) => moves.push(event.at), end: () => {} });
        say("pointerdown", 0);
        for (const at of [1, 2, 3]) {
          if (given) say("pointerrawupdate", at);
          // A frame of the screen has one of these, which says where the pointer was last.
          if (!given || at === 3) say("pointermove", at);
        }
        say("lostpointercapture");
        say("pointermove", 4);
        say("pointerrawupdate", 4);
        tell(moves);
        """,
        early,
    )
    assert found == [1, 2, 3]


@with_node
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
        tell(steps);
        """,
        [],
    )
    # Of those that wait the newest replaces the others; the last one of a gesture never waits.
    assert found == [
        [[1, 2, 3], True],
        [[1, 2, 3, 5], True],
        [[1, 2, 3, 5, 6], True],
        [[1, 2, 3, 5, 6, 8], True],
        [[1, 2, 3, 5, 6, 8], True],
        [[1, 2, 3, 5, 6, 8], False],
    ]


@with_node
def test_what_is_done_now_and_then_is_done_at_once_first_and_once_more_at_last():
    found = compute(
        """
        globalThis.requestAnimationFrame = (draw) => setTimeout(draw, 1);
        const { nowAndThen } = await import("./state.js");
        const wait = (ms) => new Promise((go) => setTimeout(go, ms));
        const drawn = [], draw = nowAndThen(given, () => drawn.push(shown));
        let shown = 0;
        for (; shown < 3; shown++) { draw(); await wait(30); }
        const soon = [...drawn];
        await wait(2 * given);
        tell([soon, drawn]);
        """,
        400,
    )
    assert found == [[0], [0, 3]]


@with_node
def test_places_without_an_assigned_speed_tell_none():
    found = compute(
        """
        const { sentenceAt } = await import("./marks.js");
        const arrays = { path_s: [0.1], path_t: [2], speed: [0.05], binding: [0] };
        const head = { limits: [{ name: "joint 1 velocity", kind: "velocity" }] };
        const at = (assigned) => sentenceAt({ head, arrays: { ...arrays, assigned } }, 0);
        const places = [at([NaN]), at([0.15])];
        // The limit is told once, at slow places as well; not at the fastest ones.
        head.shortfalls = [{ kind: "fastest", s: 0.1 }, { kind: "slowest", s: 0.103 }];
        places.push(at([0.15]));
        head.shortfalls.push({ kind: "slowest", s: 0.101 });
        tell([...places, at([0.15])]);
        """,
        [],
    )
    start, why = "s = 100.0 mm, t = 2.000 s: 50.0", "; held back by: joint 1 velocity."
    whole = f"{start} of 150.0 mm/s"
    assert found == [
        *(f"{start} mm/s{why}", f"{whole}{why}", f"{whole}{why}"),
        f"{whole}, the slowest around here{why}",
    ]


@with_node
def test_a_number_that_is_typed_takes_the_unit_alone():
    found = compute(
        """
        const { withUnit } = await import("./format.js");
        tell(given.map(([typed, shown]) => withUnit(typed, shown, "m")));
        """,
        [["40", "25 1/s"], ["40", "25mm"], ["4e1", "0.15  m/s"], ["40", "none"], ["40", "25"]],
    )
    assert found == ["40 1/s", "40 mm", "4e1 m/s", "40 m", "40"]


@with_node
def test_a_difference_that_rounds_to_nothing_has_no_sign():
    found = compute(
        """
        const { signed } = await import("./format.js");
        tell(given.map((x) => signed(x, 3)));
        """,
        [4e-4, -4e-4, 6e-4, -6e-4, 0],
    )
    assert found == ["0.000", "0.000", "+0.001", "−0.001", "0.000"]
