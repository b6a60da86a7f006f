"""`python -m soak.processes`: jobs with leads, overlaps, passes, dwells, switches, analog outputs.

Random polygons on the PMK-3s, each written twice, in SI and in other units. Exit code 1 if one
goes wrong. The judge has the arm's kinematics of its own and only looks at joint positions over
time: is the tool at work within the tolerance of the polygon, does it cover it, are leads as long
as asked, does the tool rest in dwells, are outputs switched where the tool is, and do analog
outputs follow its speed.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

import numpy as np
import yaml

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs import RunPlan, analog_outputs, teach

UNITS = {
    "m": (("m", 1.0), ("mm", 1e3), ("cm", 1e2), ("inch", 1 / 0.0254)),
    "m/s": (("m/s", 1.0), ("mm/s", 1e3), ("m/min", 60.0), ("inch/s", 1 / 0.0254)),
    "s": (("s", 1.0), ("ms", 1e3), ("us", 1e6)),
}
CENTER = np.array([0.36, 0.16])
TIMES = 20_001
# Rounding errors of units and of plans, as a share [-] and as a length [m].
SAME, NEAR = 1e-7, 1e-8
# Speeds of the tool and along its path differ by this share: the joint path is an interpolation.
SPEED = 1e-5


class Drawn:
    """A random job.

    Args:
        seed: Its seed.
    """

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        n, size = int(rng.integers(3, 7)), float(rng.uniform(0.015, 0.05))
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
        """The job as YAML."""

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
                "command_interval": write(0.004, "s"),
                "runs": {"only": {"compensation": {"method": "none"}}},
            }
        )


def tool(q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tool points [m] and speeds [m/s] of the PMK-3s, angles clockwise from y."""
    arm = ac.load_arm("pmk3s")
    assert isinstance(arm, ac.PlanarTwoLink)
    first, second = q[:, 0], q.sum(axis=1)
    ones = np.array([arm.link1, arm.link2])
    x = np.stack([np.sin(first), np.sin(second)], axis=1)
    y = np.stack([np.cos(first), np.cos(second)], axis=1)
    rate = np.stack([dq[:, 0], dq.sum(axis=1)], axis=1)
    point = np.stack([x @ ones + arm.base, y @ ones], axis=1)
    return point, np.hypot((y * rate) @ ones, (x * rate) @ ones)


def distances(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Distances of points from a polygon [m], (n,)."""
    a, along = polygon[:-1], np.diff(polygon, axis=0)
    share = np.einsum("nkd,kd->nk", points[:, None] - a, along) / (along**2).sum(axis=1)
    foot = a + np.clip(share, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


def plan(text: str) -> tuple[ac.Job, RunPlan]:
    """The job of a text, and its run without simulation."""
    job = parse_job(text)
    return job, next(iter(teach(job).values()))


def judge(seed: int) -> list[str]:
    """What is wrong with a job, in words."""
    drawn = Drawn(seed)
    try:
        job, run = plan(drawn.text(False))
    except ac.ArmContourError as error:
        return [f"refused: {error}"]
    other = plan(drawn.text(True))[1].trajectory.duration
    motion = run.trajectory
    spans = motion.contour_spans
    ends = [y for x in spans for y in (*x.t, *(x.work or ()))]
    t = np.unique(np.concatenate([np.linspace(0, motion.duration, TIMES), motion.breaks, ends]))
    point, speed = tool(motion(t), motion(t, 1))
    work = np.any([(t >= x.work[0]) & (t <= x.work[1]) for x in spans if x.work], axis=0)
    step = speed.max() * motion.duration / TIMES
    share = np.linspace(0, 1, 200)[:, None, None]
    places = (drawn.points[:-1] + share * np.diff(drawn.points, axis=0)).reshape(-1, 2)
    far = np.array([np.linalg.norm(point[work] - x, axis=1).min() for x in places])
    found = {
        "duration in other units": (abs(other / motion.duration - 1), SAME),
        "distance from the contour": (
            distances(point[work], drawn.points).max(),
            drawn.tolerance + NEAR,
        ),
        "contour not covered": (far.max(), drawn.tolerance + step + NEAR),
        "speed over assigned": (speed.max() / drawn.speed - 1, SPEED),
    }
    begin, end = spans[0], spans[-1]
    assert begin.work is not None and end.work is not None
    for name, low, high, length in (
        ("lead-in", begin.t[0], begin.work[0], drawn.lead_in),
        ("lead-out", end.work[1], end.t[1], drawn.lead_out),
    ):
        here = (t >= low) & (t <= high)
        run_length = float(np.trapezoid(speed[here], t[here]))
        found[f"length of the {name}"] = (abs(run_length - length), 1e-4 * length + 1e-7)
    resting = (t > begin.t[0] - drawn.dwell) & (t < begin.t[0])
    found["speed in the dwell"] = (speed[resting].max(initial=0.0), NEAR)
    found |= _outputs(drawn, job, run)
    return [f"{k}: {x:.3g}, allowed {most:.3g}" for k, (x, most) in found.items() if not x <= most]


def _outputs(drawn: Drawn, job: ac.Job, run: RunPlan) -> dict[str, tuple[float, float]]:
    """How far switches and analog outputs are off, and what is allowed."""
    motion = run.trajectory
    late = [0.0]
    for event in motion.events:
        span = motion.contour_spans[0 if event.value is True else -1]
        if len(motion.contour_spans) == 1 and span.work is not None:
            lead, due = (
                (drawn.on, span.work[0]) if event.value is True else (drawn.off, span.work[1])
            )
            late.append(abs(event.t - (due - lead)))
        at = np.array([event.due])
        late.append(float(np.linalg.norm(tool(motion(at), motion(at, 1))[0] - event.point)))
    times = np.sort(drawn.rng.uniform(0, motion.duration, 2000))
    power = analog_outputs(run.path, motion, job.process, run.run.limits)["power"](times)
    speed = tool(motion(times), motion(times, 1))[1]
    works = [x.work for x in motion.contour_spans if x.work is not None]
    on = np.any([(times >= low) & (times <= high) for low, high in works], axis=0)
    wanted = np.where(on, 0.2 + 0.8 * np.minimum(speed / drawn.speed, 1.0), -1.0)
    return {
        "switches": (max(late), 1e-6),
        "analog output": (float(np.abs(power - wanted).max()), SPEED),
    }


def main() -> int:
    """Judge the jobs of many seeds; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak.processes", description=__doc__)
    parser.add_argument("--count", type=int, default=500, help="how many jobs")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    given = parser.parse_args()
    wrong = 0
    for seed in range(given.first_seed, given.first_seed + given.count):
        notes = judge(seed)
        wrong += bool(notes)
        for note in notes:
            print(f"seed {seed}: {note}", flush=True)
    print(f"{given.count} jobs, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
