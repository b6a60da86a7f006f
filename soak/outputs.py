"""Outputs of random programs and jobs, judged by the joint positions over time.

Programs of lines and circles get leads, tabs, passes, overlaps, dwells, gaps, several outputs and a
place at which they are resumed. The judge takes the joint positions at every sample of the plan,
and computes its own arc length along each line and circle. It knows the gaps as they were drawn. An
output must be off wherever the tool does not work, except for its lead times, and on wherever it
works. Events and analog values are judged in the same way.

Jobs are polygons on the PMK-3s, each written twice, in SI units and in other units. The judge has
its own kinematics. It asks: Is the tool at work within the tolerance of the polygon, and does it
cover the polygon? Do leads have the required length? Does the tool rest in dwells? Are outputs
switched where the tool is, and do analog outputs follow its speed?
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.integrate import trapezoid

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_job
from armcontour.jobs import RunResult, analog_outputs
from armcontour.program import Analog, Lead, Switch, Tabs
from soak import Outcome

STEP = 1e-3
# Time by which an output may switch before or after the samples at work show it [s].
SLACK = 2e-3
# A tool within this distance of a contour is on it [m].
ON = 1e-6
# Side of the square cell in which a shape is drawn [m].
CELL = 0.035
# Lower left corner of the first cell [m].
ORIGIN = np.array([0.27, 0.13])
# Assigned speed of the tool [m/s].
ASSIGNED = 0.06


@dataclass
class Shape:
    """A line or a circle, and where the drawing has it off: in every lap, and before its begin."""

    start: np.ndarray
    end: np.ndarray | None
    centre: np.ndarray | None
    turn: float = 1.0
    off: list[tuple[float, float]] = field(default_factory=list)
    begin: float = 0.0
    layer: str = ""
    events: tuple[ac.Event, ...] = ()

    @property
    def length(self) -> float:
        """Length of one lap [m]."""
        if self.centre is None:
            return float(np.linalg.norm(self.end - self.start))
        return float(2 * np.pi * np.linalg.norm(self.start - self.centre))

    def path(self) -> ac.Path:
        """Return the path for armcontour."""
        if self.centre is None:
            return ac.Path.polyline([self.start, self.end])
        spokes = [self.at(k * self.length / 2) for k in (0, 1)]
        middles = [self.at((k + 0.5) * self.length / 2) for k in (0, 1)]
        return ac.Path(
            segments=[
                ac.Arc.through(spokes[0], middles[0], spokes[1]),
                ac.Arc.through(spokes[1], middles[1], spokes[0]),
            ]
        )

    def at(self, s: float) -> np.ndarray:
        """Return the point of a circle at an arc length."""
        spoke = self.start - self.centre
        a = self.turn * s / np.linalg.norm(spoke)
        c = np.cos(a)
        d = np.sin(a)
        return self.centre + np.array([c * spoke[0] - d * spoke[1], d * spoke[0] + c * spoke[1]])

    def places(self, tool: np.ndarray, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the last arc lengths of tool points before `end`, and their distances [m]."""
        if self.centre is None:
            along = (self.end - self.start) / self.length
            s = (tool - self.start) @ along
            beyond = np.maximum(0, np.maximum(-s, s - self.length))
            return s, np.hypot((tool - self.start) @ [-along[1], along[0]], beyond)
        spokes = tool - self.centre
        first = self.start - self.centre
        radius = np.linalg.norm(first)
        angle = np.arctan2(spokes[:, 1], spokes[:, 0]) - np.arctan2(first[1], first[0])
        s = np.unwrap(self.turn * angle) * radius
        distance = np.abs(np.linalg.norm(spokes, axis=1) - radius)
        last = np.flatnonzero(distance < ON)[-1]
        return s + np.round((end - s[last]) / self.length) * self.length, distance


def draw(rng: np.random.Generator, number: int, name: str, style: str) -> Shape:
    """Draw a line or a circle in a cell of its own, with gaps as the style has them."""
    corner = ORIGIN + CELL * np.array([number % 3, number // 3])
    middle = corner + CELL / 2
    if rng.random() < 0.5:
        angle = rng.uniform(0, 2 * np.pi)
        half = 0.5 * rng.uniform(0.014, 0.022) * np.array([np.cos(angle), np.sin(angle)])
        outline = Shape(middle - half, middle + half, None)
    else:
        angle = rng.uniform(0, 2 * np.pi)
        radius = rng.uniform(0.005, 0.01)
        start = middle + radius * np.array([np.cos(angle), np.sin(angle)])
        outline = Shape(start, None, middle, rng.choice([-1.0, 1.0]))
    length = outline.length
    gaps = np.sort(rng.uniform(0.3, 0.9, 2 * rng.integers(0, 3))) * length
    gaps = gaps.reshape(-1, 2)
    outline.off = [(a, b) for a, b in gaps.tolist() if b - a > 1e-3]
    # Leads of switches are shorter than the time between two gaps.
    if len(outline.off) == 2 and outline.off[1][0] - outline.off[0][1] < 3e-3:
        outline.off = outline.off[:1]
    if style == "none":
        outline.off = []
    events = []
    for begin, end in outline.off:
        events += [ac.Event(name=name, value=False, s=begin)]
        events += [ac.Event(name=name, value=True, s=end)]
    if style == "late":
        outline.begin = 0.2 * length
        events = [ac.Event(name=name, s=0.2 * length), *events]
    if style == "file":
        events = [ac.Event(name=name), *events, ac.Event(name=name, value=False, s=length)]
    outline.events = tuple(events)
    return outline


def lead(rng: np.random.Generator, active: bool) -> Lead | None:
    """Draw a random lead, or none."""
    if rng.random() < 0.4:
        return None
    return Lead(
        length=rng.uniform(1e-3, 3e-3), shape=str(rng.choice(["line", "arc"])), active=active
    )


class Visit(NamedTuple):
    """One run of the tool along a shape, up to the arc length `end` [m]."""

    shape: Shape
    end: float


@dataclass(frozen=True, kw_only=True)
class DrawnProgram:
    """A random program with its process.

    Args:
        moves: Moves of the program before its preparation.
        process: The process.
        visits: What the tool runs along, in order, from the place of resumption on.
        begun: Arc length of the first visit at which the work is resumed [m].
        active: True if outputs may be on along leads.
        early: Lead time of the analog output "power" [s].
    """

    moves: tuple[Any, ...]
    process: ac.Process
    visits: list[Visit]
    begun: float
    active: bool
    early: float


def judge_program(seed: int) -> int:
    """Judge one program; returns the number of samples, 0 if gaps are too short for its leads."""
    drawn = _draw_program(np.random.default_rng(seed))
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=ASSIGNED)
    program = ac.prepare(ac.Program(moves=drawn.moves), drawn.process)
    try:
        plan = ac.plan(program, arm, limits)
    except InvalidInput as error:
        if "Reduce the advance" in str(error):
            return 0
        raise
    t = np.arange(0, plan.duration + 0.05, STEP)
    works, leads = _find_work(drawn, plan, arm.tool_position(plan(np.minimum(t, plan.duration))), t)
    analog = analog_outputs(program, plan, drawn.process, limits)
    _judge_outputs(f"seed {seed}", drawn, plan, t, works, leads, analog)
    return len(t)


def _draw_program(rng: np.random.Generator) -> DrawnProgram:
    """Draw moves, a process, and where the program is resumed."""
    in_order = rng.random() < 0.4
    shapes, moves = _draw_moves(rng, in_order)
    on_lead, off_lead = rng.uniform(0, 0.015, 2) * (rng.random(2) < 0.6)
    switches = {x: Switch(name=x, on_lead=on_lead, off_lead=off_lead) for x in ("laser", "glue")}
    tabs = Tabs(width=1e-3, count=int(rng.integers(1, 3))) if rng.random() < 0.4 else None
    overlap = rng.uniform(0, 2e-3) * (rng.random() < 0.5)
    passes = int(rng.integers(1, 4)) if rng.random() < 0.4 else 1
    # Along active leads the outputs may be on.
    active = bool(rng.random() < 0.3)
    early = float(rng.choice([0.0, 0.01, -0.01]))
    layers = {x.layer for x in shapes}
    process = ac.Process(
        begin="drawn",
        switch=switches["laser"],
        by_layer={"SEAL": {"switch": switches["glue"]}} if "SEAL" in layers else {},
        tabs=tabs,
        overlap=overlap,
        passes=passes,
        lead_in=lead(rng, active),
        lead_out=lead(rng, active),
        # Something must come before the first event with its lead.
        dwell=rng.uniform(0.02, 0.1),
        analog=(
            Analog(name="power", rest=0.3, off=int(rng.integers(0, 2)) * -1, lead_time=early),
            Analog(name="flow", rest=1.0, full=1.0, follows="laser"),
        ),
    )
    visits = _list_visits(shapes, process)
    begun = 0.0
    if rng.random() < 0.6:
        begun = resume_at = rng.uniform(0, sum(x.end for x in visits) - 1e-3)
        while begun >= visits[0].end:
            begun -= visits.pop(0).end
        process = dataclasses.replace(process, resume_at=resume_at)
    return DrawnProgram(
        moves=moves, process=process, visits=visits, begun=begun, active=active, early=early
    )


def _draw_moves(rng: np.random.Generator, in_order: bool) -> tuple[list[Shape], tuple[Any, ...]]:
    """Draw shapes, and the moves of a program that runs along them, with others in between."""
    shapes: list[Shape] = []
    moves: list[object] = []
    for k in range(rng.integers(1, 6)):
        layer = str(rng.choice(["", "SEAL"]))
        name = "glue" if layer else "laser"
        style = str(rng.choice(["file", "late"] if in_order else ["none", "gaps", "late"]))
        shape = draw(rng, k, name, style)
        if in_order and style == "late":
            # What is on at the end of a contour stays on in a program with an order.
            shape.events = (*shape.events, ac.Event(name=name, value=False, s=shape.length))
        shape.layer = layer
        shapes.append(shape)
        if in_order:
            moves.append(ac.Rapid() if rng.random() < 0.7 else ac.Dwell(duration=0.05))
            if rng.random() < 0.3:
                moves.append(ac.Event(name=name))
                moves.append(ac.Event(name=name, value=False))
        contour = ac.Contour(path=shape.path(), events=shape.events, layer=layer, name=f"c{k}")
        moves.append(contour)
    return shapes, tuple(moves)


def _list_visits(shapes: list[Shape], process: ac.Process) -> list[Visit]:
    """List the visits of passes and overlap, and mark tabs as parts without work."""
    visits: list[Visit] = []
    for shape in shapes:
        if shape.centre is None:
            visits += [Visit(shape, shape.length)] * process.passes
            continue
        visits.append(Visit(shape, process.passes * shape.length + process.overlap))
        if process.tabs is not None:
            for k in range(process.tabs.count):
                s = (k + 0.5) * shape.length / process.tabs.count
                shape.off.append((s - process.tabs.width / 2, s + process.tabs.width / 2))
    return visits


def _find_work(
    drawn: DrawnProgram, plan: ac.Trajectory, tool: np.ndarray, t: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return masks over `t`: where the tool works, by output, and where it is on active leads."""
    speed = np.linalg.norm(np.gradient(tool, STEP, axis=0), axis=1)
    works = {x: np.zeros(len(t), dtype=bool) for x in ("laser", "glue")}
    leads = np.zeros(len(t), dtype=bool)
    spans = [x for x in plan.spans if x.kind == "contour"]
    assert len(spans) == len(drawn.visits)
    for k, (span, (shape, end)) in enumerate(zip(spans, drawn.visits, strict=True)):
        inside = (t >= span.t[0]) & (t <= span.t[1])
        s, distance = shape.places(tool[inside], end)
        begin = max(shape.begin, drawn.begun if k == 0 else 0.0)
        work = (distance < ON) & (s >= begin) & (s <= end)
        for a, b in shape.off:
            place = s if shape.centre is None else s % shape.length
            work &= (place < a) | (place > b)
        if drawn.active:
            at_work = np.flatnonzero(inside)[work]
            leads |= inside & ((t < t[at_work[0]]) | (t > t[at_work[-1]]))
        works["glue" if shape.layer else "laser"][inside] |= work & (speed[inside] > 1e-6)
    return works, leads


def _judge_outputs(
    title: str,
    drawn: DrawnProgram,
    plan: ac.Trajectory,
    t: np.ndarray,
    works: dict[str, np.ndarray],
    leads: np.ndarray,
    analog: Any,
) -> None:
    """Judge all digital and analog outputs at the times `t`."""
    switch = drawn.process.switch
    for name, work in works.items():
        on = np.zeros(len(t), dtype=bool)
        for event in plan.events:
            if event.name == name:
                on[t >= event.t] = event.value is not False
        _judge_output(f"{title}, {name}", t, on, work, leads, switch.on_lead, switch.off_lead)
        if name == "laser":
            # It follows the laser, on the other layer too, where the laser is off.
            _judge_output(f"{title}, flow", t, analog["flow"](t) > 0, work, leads, 0.0, 0.0)
    power = analog["power"](t) != drawn.process.analog[0].off
    work = works["laser"] | works["glue"]
    ahead = np.interp(t + drawn.early, t, work.astype(float), right=0.0) > 0.5
    leads_ahead = np.interp(t + drawn.early, t, leads.astype(float), right=0.0) > 0
    _judge_output(f"{title}, power", t, power, ahead, leads_ahead, 0.0, 0.0)


def _judge_output(
    title: str,
    t: np.ndarray,
    on: np.ndarray,
    work: np.ndarray,
    leads: np.ndarray,
    on_lead: float,
    off_lead: float,
) -> None:
    """Raise AssertionError where an output is on without work, or off at work."""

    def count(mask: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        done = np.concatenate([[0], np.cumsum(mask)])
        i = np.searchsorted(t, low)
        j = np.searchsorted(t, high, side="right")
        return done[j] - done[i], j - i

    some, _ = count(work | leads, t - SLACK, t + on_lead + SLACK)
    wrong = on & (some == 0)
    assert not wrong.any(), f"{title}: on without work at {t[wrong][:5]} s, {wrong.sum()} samples"
    some, all_of_them = count(work, t - SLACK, t + off_lead + SLACK)
    wrong = ~on & (some == all_of_them)
    assert not wrong.any(), f"{title}: off at work at {t[wrong][:5]} s, {wrong.sum()} samples"


UNITS = {
    "m": (("m", 1.0), ("mm", 1e3), ("cm", 1e2), ("inch", 1 / 0.0254)),
    "m/s": (("m/s", 1.0), ("mm/s", 1e3), ("m/min", 60.0), ("inch/s", 1 / 0.0254)),
    "s": (("s", 1.0), ("ms", 1e3), ("us", 1e6)),
}
CENTER = np.array([0.36, 0.16])
TIMES = 20_001
# Share by which the durations of a job in two systems of units may differ by rounding errors.
SAME = 1e-7
# Rounding errors that are allowed in distances [m], and in the speed of a tool at rest [m/s].
NEAR = 1e-8
# Speeds of the tool and along its path differ by this share: the joint path is an interpolation.
SPEED = 1e-5


class DrawnJob:
    """A random job."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        n = int(rng.integers(3, 7))
        size = float(rng.uniform(0.015, 0.05))
        angle = np.linspace(0, 2 * np.pi, n, endpoint=False) + rng.uniform(-0.3, 0.3, n)
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        corners = CENTER + size * rng.uniform(0.6, 1.2, (n, 1)) * around
        self.closed = bool(rng.random() < 0.75)
        self.points = np.append(corners, corners[:1], axis=0) if self.closed else corners
        self.tolerance = size * float(10 ** rng.uniform(-2, -1))
        self.speed = float(rng.uniform(0.02, 0.15))
        self.lead_in, self.lead_out, self.dwell, self.on, self.off = (
            float(rng.uniform(low, high)) * bool(rng.random() < share)
            for low, high, share in (
                (0.1 * size, 0.5 * size, 0.8),
                (0.1 * size, 0.5 * size, 0.5),
                (0.05, 0.3, 0.5),
                (0.0, 0.02, 0.8),
                (0.0, 0.02, 0.8),
            )
        )
        if not self.lead_in and not self.dwell:
            self.on = 0.0
        self.overlap = self.closed * float(rng.uniform(0, 0.5 * size)) * bool(rng.random() < 0.5)
        self.passes = int(rng.integers(1, 4)) if self.closed else 1

    def text(self, other_units: bool) -> str:
        """Return the job as YAML."""

        def write(value: float, unit: str) -> Any:
            if not other_units:
                return float(value)
            name, factor = UNITS[unit][self.rng.integers(len(UNITS[unit]))]
            return f"{float(value) * factor!r} {name}"

        process: dict[str, Any] = {"passes": self.passes, "overlap": write(self.overlap, "m")}
        for name, length in (("lead_in", self.lead_in), ("lead_out", self.lead_out)):
            if length:
                process[name] = {"length": write(length, "m")}
        process["dwell"] = write(self.dwell, "s")
        leads = {"on_lead": write(self.on, "s"), "off_lead": write(self.off, "s")}
        process["switch"] = {"name": "laser", **leads}
        process["analog"] = [{"name": "power", "rest": 0.2, "off": -1.0}]
        return yaml.safe_dump(
            {
                "name": "drawn",
                "arm": "pmk3s",
                "path": {"points": [[write(x, "m") for x in p] for p in self.points]},
                "limits": {"speed": write(self.speed, "m/s"), "joint_acceleration": 4.0},
                "corners": {"tolerance": write(self.tolerance, "m")},
                "process": process,
                "servo": {"kp": 25.0, "kv": 150.0},
                "cycle": write(0.004, "s"),
                "runs": {"only": {"compensation": {"method": "none"}}},
            }
        )


def tool(q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return tool points [m] and speeds [m/s] of the PMK-3s, angles clockwise from y."""
    arm = ac.load_arm("pmk3s")
    assert isinstance(arm, ac.PlanarTwoLink)
    first = q[:, 0]
    second = q.sum(axis=1)
    ones = np.array([arm.link1, arm.link2])
    x = np.stack([np.sin(first), np.sin(second)], axis=1)
    y = np.stack([np.cos(first), np.cos(second)], axis=1)
    rate = np.stack([dq[:, 0], dq.sum(axis=1)], axis=1)
    point = np.stack([x @ ones + arm.base, y @ ones], axis=1)
    return point, np.hypot((y * rate) @ ones, (x * rate) @ ones)


def distances(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Return the distances of points from a polygon [m], (n,)."""
    a = polygon[:-1]
    along = np.diff(polygon, axis=0)
    share = np.einsum("nkd,kd->nk", points[:, None] - a, along) / (along**2).sum(axis=1)
    foot = a + np.clip(share, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


def plan(text: str) -> tuple[ac.Job, RunResult]:
    """Read a job's text, and plan its run without simulation."""
    job = parse_job(text)
    return job, next(iter(ac.run(job, simulate=False).runs.values()))


def judge_job(seed: int) -> list[str]:
    """List what is wrong with a job, in words."""
    drawn = DrawnJob(seed)
    try:
        job, run = plan(drawn.text(False))
    except ac.ArmContourError as error:
        return [f"refused: {error}"]
    other = plan(drawn.text(True))[1].trajectory.duration
    motion = run.trajectory
    spans = motion.contour_spans
    ends = []
    for x in spans:
        ends += [*x.t, *(x.work or ())]
    t = np.unique(np.concatenate([np.linspace(0, motion.duration, TIMES), motion.breaks, ends]))
    point, speed = tool(motion(t), motion(t, 1))
    work = np.any([(t >= x.work[0]) & (t <= x.work[1]) for x in spans if x.work], axis=0)
    step = speed.max() * motion.duration / TIMES
    share = np.linspace(0, 1, 200)[:, None, None]
    places = (drawn.points[:-1] + share * np.diff(drawn.points, axis=0)).reshape(-1, 2)
    far = np.array([np.linalg.norm(point[work] - x, axis=1).min() for x in places])
    figures = {
        "duration in other units": (abs(other / motion.duration - 1), SAME),
        "distance from the contour": (
            distances(point[work], drawn.points).max(),
            drawn.tolerance + NEAR,
        ),
        "contour not covered": (far.max(), drawn.tolerance + step + NEAR),
        "speed over assigned": (speed.max() / drawn.speed - 1, SPEED),
    }
    begin = spans[0]
    end = spans[-1]
    assert begin.work is not None and end.work is not None
    for name, low, high, length in (
        ("lead-in", begin.t[0], begin.work[0], drawn.lead_in),
        ("lead-out", end.work[1], end.t[1], drawn.lead_out),
    ):
        mask = (t >= low) & (t <= high)
        run_length = float(trapezoid(speed[mask], t[mask]))
        figures[f"length of the {name}"] = (abs(run_length - length), 1e-4 * length + 1e-7)
    resting = (t > begin.t[0] - drawn.dwell) & (t < begin.t[0])
    figures["speed in the dwell"] = (speed[resting].max(initial=0.0), NEAR)
    return [
        f"{k}: {x:.3g}, allowed {allowed:.3g}"
        for k, (x, allowed) in figures.items()
        if not x <= allowed
    ]


def run(seed: int) -> Outcome:
    """Judge the outputs of a program, and every fourth time a job."""
    if seed % 4 == 0:
        return Outcome(kind="job", result="judged", notes=judge_job(seed))
    try:
        samples = judge_program(seed)
    except AssertionError as error:
        return Outcome(kind="program", result="wrong", notes=[str(error)])
    return Outcome(kind="program", result="judged" if samples else "refused")
