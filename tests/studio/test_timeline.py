"""Times of the page's timeline, and places of a motion, computed by node."""

import numpy as np
import pytest
from tests.studio.test_arithmetic import NODE, compute

pytestmark = pytest.mark.skipif(NODE is None, reason="the page's arithmetic is run by node")
DURATION = 12.0
# Runs commands (method, arguments) on a scale, and tells its state after each.
SCALE = """
const { TimeScale } = await import("./time_scale.js");
const scale = new TimeScale();
scale.width = given.width;
scale.fit(given.duration);
const states = [];
for (const [name, ...rest] of given.commands) {
  scale[name](...rest);
  states.push([scale.begin, scale.end, scale.isWhole]);
}
const times = given.places.map((x) => scale.timeAt(x));
const places = given.times.map((t) => scale.xOf(t));
tell({ states, times, places });
"""
# A picture with the contours of `given`: lists of (time, speed), and the assigned speed.
PICTURE = """
const places = await import("./motion_places.js");
const lines = given.contours;
const breaksOf = (all) => {
  const breaks = [0];
  for (const x of all) breaks.push(breaks[breaks.length - 1] + x.length);
  return Uint32Array.from(breaks);
};
const column = (all, k) => Float64Array.from(all.flat(), (x) => x[k]);
const arrays = { path_t: column(lines, 0), speed: column(lines, 1), path_breaks: breaksOf(lines) };
arrays.assigned = arrays.path_t.map(() => given.assigned ?? NaN);
const { rapids } = given;
if (rapids) {
  Object.assign(arrays, { rapid_t: column(rapids, 0), rapid_speed: column(rapids, 1) });
  arrays.rapid_breaks = breaksOf(rapids);
}
const contours = lines.map((x, k) => ({ number: k + 1, t: [x[0][0], x[x.length - 1][0]] }));
const picture = { head: { contours }, arrays };
"""
# Two contours with a rapid and a wait between them; the second has a stop and a slow place.
CONTOURS = [
    [(0.0, 0.0), (0.5, 0.1), (1.0, 0.1), (1.5, 0.0)],
    [(3.0, 0.0), (3.5, 0.1), (4.0, 0.0), (4.5, 0.08), (5.0, 0.03), (5.5, 0.09), (6.0, 0.0)],
]
RAPIDS = [[(2.0, 0.0), (2.5, 0.4), (3.0, 0.0)]]


def scaled(commands, *, width=1000, places=(), times=()):
    given = {"width": width, "duration": DURATION, "commands": commands}
    return compute(SCALE, given | {"places": list(places), "times": list(times)})


def test_a_zoomed_part_stays_within_the_motion():
    random = np.random.default_rng(7)
    commands = []
    for _ in range(300):
        name = str(random.choice(["zoom", "shift", "show", "follow", "fit"]))
        first, second = random.uniform(-3, DURATION + 3, 2)
        arguments = {
            "zoom": [float(np.exp(random.normal())), first],
            "shift": [first - 6],
            "show": sorted([first, second]),
            "follow": [float(np.clip(first, 0, DURATION))],
            "fit": [DURATION],
        }
        commands.append([name, *arguments[name]])
    states = scaled(commands)["states"]
    for (name, *rest), (begin, end, whole) in zip(commands, states, strict=True):
        assert -1e-9 <= begin < end <= DURATION + 1e-9
        assert whole == (begin < 1e-9 and end > DURATION - 1e-9)
        if name == "follow":
            assert begin - 1e-9 <= rest[0] <= end + 1e-9
    # The zoom had effects in both directions.
    lengths = np.diff(np.array(states)[:, :2].astype(float), axis=1)
    assert lengths.min() < 0.1 * DURATION and lengths.max() == pytest.approx(DURATION)


def test_the_time_at_the_pointer_stays_there_while_it_is_zoomed():
    found = scaled([["show", 2, 10], ["zoom", 0.25, 5.0]], times=[5.0], places=[0, 1000])
    # Before: 5 s was at 3/8 of the width.
    assert found["places"] == [pytest.approx(375)]
    assert found["times"] == [pytest.approx(5 - 0.75), pytest.approx(5 + 1.25)]


def test_a_part_stays_and_the_whole_remains_the_whole_if_the_motion_changes():
    part = scaled([["show", 2, 4], ["fit", 9.0], ["fit", 3.0], ["showAll"], ["fit", 30.0]])
    assert part["states"] == [
        [2, 4, False],
        [2, 4, False],
        [1, 3, False],
        [0, 3, True],
        [0, 30, True],
    ]


def test_places_are_reached_forwards_and_backwards():
    script = """
    const walk = (step, way) => {
      const found = [];
      for (let t = way > 0 ? -1 : 7, k = 0; k < 20; k += 1) {
        t = step(t, way);
        if (t === undefined) break;
        found.push(t);
      }
      return found;
    };
    const contour = (t, way) => picture.head.contours[places.contourBeside(picture, t, way)]?.t[0];
    const stop = (t, way) => places.stopBeside(picture, t, way);
    tell({ contours: [walk(contour, 1), walk(contour, -1)], stops: [walk(stop, 1), walk(stop, -1)],
      again: places.contourBeside(picture, 3.5, -1) });
    """
    found = compute(PICTURE + script, {"contours": CONTOURS})
    begins = [x[0][0] for x in CONTOURS]
    stops = [t for line in CONTOURS for t, speed in line if speed == 0]
    assert found["contours"] == [begins, begins[::-1]]
    assert found["stops"] == [stops, stops[::-1]]
    # Within a contour, its own begin comes first.
    assert found["again"] == 1


@pytest.mark.parametrize("assigned", [None, 0.1])
def test_the_slowest_place_is_the_lowest_minimum_inside_a_contour(assigned):
    script = "tell(places.slowestOf(picture) ?? null);"
    with_stop = compute(PICTURE + script, {"contours": CONTOURS, "assigned": assigned})
    assert with_stop == 4.0
    without = [CONTOURS[0], [x for x in CONTOURS[1] if x[0] != 4.0]]
    assert compute(PICTURE + script, {"contours": without, "assigned": assigned}) == 5.0
    # Contours that only speed up and slow down have no slowest place.
    assert compute(PICTURE + script, {"contours": CONTOURS[:1], "assigned": assigned}) is None


def test_the_speed_at_a_time_is_that_of_the_contour_or_the_rapid_there():
    script = "tell(given.times.map((t) => places.speedAt(picture, t)));"
    given = {"contours": CONTOURS, "rapids": RAPIDS, "times": [0.25, 1.75, 2.25, 5.25]}
    found = compute(PICTURE + script, given)
    assert [x["contour"] for x in found] == [0, -1, -1, 1]
    speeds = [x["speed"] for x in found]
    # Between the end of a contour and the rapid, the tool waits: JSON has no NaN.
    assert speeds[1] is None
    assert [speeds[k] for k in (0, 2, 3)] == pytest.approx([0.05, 0.2, 0.06])


LABELS = """
const { timeLabel, timeStep } = await import("./time_labels.js");
tell(given.map(([span, duration, room]) => {
  const step = timeStep(span / room, duration);
  const labels = [];
  for (let k = 0; k * step <= span; k++) labels.push(timeLabel(k * step, step, duration));
  return { step, labels };
}));
"""


def seconds_of(label):
    """Time of a label [s]."""
    number, _, unit = label.partition(" ")
    if unit == "s":
        return float(number)
    parts = [float(x) for x in number.split(":")]
    sizes = {"min": [60, 1], "h": [3600, 60], "": [3600, 60, 1]}[unit]
    assert len(parts) == len(sizes) and all(x < 60 for x in parts[1:])
    return sum(size * x for size, x in zip(sizes, parts, strict=True))


def test_labels_of_seconds_minutes_and_hours_are_round_and_state_their_time():
    spans = [0.002, 0.7, 13.2, 119.0, 125.0, 600.0, 3599.0, 3700.0, 30_000.0, 200_000.0]
    cases = [(x, x, room) for x in spans for room in (4, 13)]
    # Zoomed parts of long motions.
    cases += [(0.01, 5000.0, 8), (1.0, 300.0, 8), (40.0, 5000.0, 8)]
    for (span, duration, room), axis in zip(cases, compute(LABELS, cases), strict=True):
        labels = axis["labels"]
        step = axis["step"]
        # Not more than have room, and not much fewer.
        assert span / room <= step * (1 + 1e-9) and step <= 4.1 * span / room
        times = [seconds_of(x) for x in labels]
        assert times == pytest.approx([k * step for k in range(len(labels))])
        assert len(set(labels)) == len(labels)
        assert max(map(len, labels)) <= 12
        assert ("s" in labels[-1]) == (duration < 120)
