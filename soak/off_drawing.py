"""The distance between tool and drawing in random jobs, measured from dense points.

Tool and drawing are sampled as chords with errors of at most 10 nm, and scipy's k-d tree finds the
nearest chord. The package's evaluation and geometry are not used.
"""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import yaml
from scipy.spatial import cKDTree

import armcontour as ac
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.jobs.run_result import RunResult
from soak import Outcome

Random = np.random.Generator
DRAWINGS = FilePath(__file__).parents[1] / "examples" / "drawings"
# Largest amount by which a stated bound may be below the distance [m], and largest relative
# difference of a measured one.
SLACK = 1e-7
SAME = 0.01
# Time between samples of the tool [s].
RESOLUTION = 1e-4
# Largest distance between samples of a path [m], and smallest number of samples per segment, so
# that chords are about 10 nm from the path at most.
STEP = 5e-6
SAMPLES = 17
# Number of nearest samples whose chords are tried.
NEIGHBOURS = 12
# Cells and the drawings that they reach without a collision.
DRAWN = (("ur5e", "plate.dxf"), ("ur5e", "pocket.ngc"), ("panda", "plate.dxf"))
# Jerk limits of fast, usual and slow arms [rad/s^3].
JERKS = (30.0, 400.0, 4000.0)


def run(seed: int) -> Outcome:
    """Run the job of a seed and compare its distance from the drawing with that of the points."""
    rng = np.random.default_rng((33, seed))
    kind = list(KINDS)[seed % len(KINDS)]
    notes = list[str]()
    worst = 0.0
    result = next(iter(ac.run(KINDS[kind](rng)).runs.values()))
    stated = float(result.to_data()["off_drawing"].value)
    tool = measure_tool(result)
    worst = stated / max(tool, SLACK)
    if stated < tool - SLACK or stated > tool * (1 + SAME) + SLACK:
        notes.append(f"off the drawing {stated:.9f} m, but the points say {tool:.9f} m")
    if result.evaluation.off_drawing != stated:
        notes.append(f"the evaluation says {result.evaluation.off_drawing}")
    deviations = zip(result.deviations, measure_paths(result), strict=True)
    for k, (deviation, distance) in enumerate(deviations):
        if deviation.total < distance - SLACK:
            notes.append(f"path {k} deviates by {deviation}, but the points say {distance:.9f} m")
    return Outcome(kind=kind, result="planned", notes=notes, worst=worst)


def measure_tool(result: RunResult) -> float:
    """Return the distance between tool and drawing in the process, in both directions [m]."""
    plant = ac.ServoPlant(result.arm, result.servo)
    executed = ac.simulate(result.set_points, plant, resolution=RESOLUTION)
    points = in_space(executed.tool)
    t = executed.t
    largest = 0.0
    alone = result.path.single_path is not None
    contours = result.objective.contours
    for contour, span in zip(contours, result.trajectory.contour_spans, strict=True):
        begin, end = (t[0], t[-1]) if alone else span.work
        working = (t >= begin) & (t <= end)
        drawn = sample(contour.path, 0.0, contour.path.length)
        required = sample(contour.path, *contour.at_work)
        # A tool may leave the last point of a contour after the process is off.
        around = (t >= begin - 0.05) & (t <= end + 0.05)
        largest = max(largest, farthest(points[working], drawn))
        largest = max(largest, farthest(required, points[around]))
    return largest


def measure_paths(result: RunResult) -> list[float]:
    """Return each contour's distance between path and drawing, in both directions [m]."""
    distances = []
    pairs = zip(result.path.contours, result.objective.contours, strict=True)
    for contour, drawn in pairs:
        path = sample(contour.path, 0.0, contour.path.length)
        objective = sample(drawn.path, 0.0, drawn.path.length)
        distances.append(max(farthest(path, objective), farthest(objective, path)))
    return distances


def sample(path: ac.Path, begin: float, end: float) -> np.ndarray:
    """Sample a path between two arc lengths [m], with all its vertices, (n, 3)."""
    even = np.linspace(begin, end, max(3, int((end - begin) / STEP)))
    short = np.linspace(path.breaks[:-1], path.breaks[1:], SAMPLES).ravel()
    inside = short[(short > begin) & (short < end)]
    return in_space(path(np.union1d(even, inside)))


def in_space(points: np.ndarray) -> np.ndarray:
    """Return points in the plane or in space as points in space, (n, 3)."""
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def farthest(points: np.ndarray, line: np.ndarray) -> float:
    """Return the largest distance of points from the chords of a polyline [m]."""
    _, nearest = cKDTree(line).query(points, k=min(NEIGHBOURS, len(line)))
    best = np.full(len(points), np.inf)
    for column in nearest.T:
        for first in (column - 1, column):
            i = np.clip(first, 0, len(line) - 2)
            chord = line[i + 1] - line[i]
            square = np.maximum((chord * chord).sum(axis=1), 1e-300)
            share = np.clip(((points - line[i]) * chord).sum(axis=1) / square, 0.0, 1.0)
            away = points - line[i] - share[:, None] * chord
            best = np.minimum(best, np.sqrt((away * away).sum(axis=1)))
    return float(best.max())


# Jobs


def _job(rng: Random, arm: Any, path: dict[str, Any], **keys: Any) -> ac.Job:
    """Return a job with a random tolerance and servo; `keys` replace keys of the job file."""
    data = {
        "name": "random",
        "arm": arm,
        "path": path,
        "limits": {"speed": float(rng.uniform(0.05, 0.3))},
        "corners": {"tolerance": float(10 ** rng.uniform(-5, -2.7))},
        "servo": {"kp": float(rng.uniform(15, 60)), "kv": float(rng.uniform(120, 300))},
        "cycle": 0.004,
        "runs": {"only": {"compensation": {"method": str(rng.choice(["none", "inverse"]))}}},
    }
    if rng.random() < 0.5:
        data["accuracy"] = float(10 ** rng.uniform(-6, -2.5))
    return parse_job(yaml.safe_dump(data | keys))


def _with_jerk(rng: Random) -> dict[str, float]:
    """Return the limits with a speed and a jerk limit."""
    return {"speed": float(rng.uniform(0.05, 0.3)), "joint_jerk": float(rng.choice(JERKS))}


def _corners_in_plane(rng: Random) -> ac.Job:
    """Make a job with lines of a planar arm, rounded with continuous curvature."""
    count = int(rng.integers(3, 6))
    points = np.array([0.33, 0.2]) + rng.uniform(-0.05, 0.05, (count, 2))
    return _job(rng, "pmk3s", {"points": points.tolist()}, limits=_with_jerk(rng))


def _tangent_arcs(rng: Random) -> dict[str, Any]:
    """Make lines and arcs that meet without a corner, and one corner."""
    a, r, b = rng.uniform(0.01, 0.06, 3).tolist()
    turn = float(rng.uniform(40, 170))
    end = np.radians(turn)
    centre = np.array([a, r])
    out = centre + r * np.array([np.sin(end), -np.cos(end)])
    far = out + b * np.array([np.cos(end), np.sin(end)])
    last = far + rng.uniform(-0.04, 0.04, 2)
    return {
        "start": [0, 0, 0],
        "segments": [
            {"to": [a, 0, 0]},
            {"center": [a, r, 0], "angle": f"{turn} deg", "normal": [0, 0, 1]},
            {"to": [*far.tolist(), 0]},
            {"to": [*last.tolist(), 0]},
        ],
    }


def _in_work_frame(name: str, rng: Random) -> dict[str, Any]:
    """Place an arm in space, with the work frame in front of it."""
    place = [float(0.45 + rng.uniform(-0.03, 0.03)), float(rng.uniform(-0.1, 0.1)), 0.15]
    return {"name": name, "tool": {"position": [0, 0, "120 mm"]}, "work": {"position": place}}


def _arcs_in_space(name: str) -> Any:
    """Return a function that makes a job of lines and arcs for an arm in space."""

    def make(rng: Random) -> ac.Job:
        path = {**_tangent_arcs(rng), "orientation": {"axis": [0, 0, -1]}}
        return _job(rng, _in_work_frame(name, rng), path, limits=_with_jerk(rng))

    return make


def _follows_tangent(rng: Random) -> ac.Job:
    """Make lines and arcs whose orientation follows the tangent, smoothed, then rounded."""
    path = {**_tangent_arcs(rng), "orientation": {"follow_tangent": {"up": [0, 0, 1]}}}
    tolerance = float(10 ** rng.uniform(-4, -3))
    corners = {"tolerance": tolerance, "angular_tolerance": "3 deg"}
    arm = _in_work_frame("ur5e", rng)
    return _job(rng, arm, path, limits=_with_jerk(rng), corners=corners)


def _arcs_alone(rng: Random) -> ac.Job:
    """Make a job with corners rounded with arcs, without a jerk limit."""
    path = {**_tangent_arcs(rng), "orientation": {"axis": [0, 0, -1]}}
    return _job(rng, _in_work_frame("panda", rng), path)


def _shaped(rng: Random) -> ac.Job:
    """Make a job with corners of shape free."""
    points = np.array([0.33, 0.2]) + rng.uniform(-0.05, 0.05, (3, 2))
    corners = {"shape": "free", "tolerance": float(10 ** rng.uniform(-4, -2.7))}
    return _job(rng, "pmk3s", {"points": points.tolist()}, corners=corners)


def _sharp(rng: Random) -> ac.Job:
    """Make a job with sharp corners."""
    points = np.array([0.33, 0.2]) + rng.uniform(-0.05, 0.05, (4, 2))
    return _job(rng, "pmk3s", {"points": points.tolist()}, corners="sharp")


def _curve(rng: Random) -> ac.Job:
    """Make a path in Python with parabolas at corners and smoothed curvature."""
    points = np.array([0.33, 0.2]) + rng.uniform(-0.05, 0.05, (4, 2))
    line = ac.Path.polyline(points)
    path = ac.geometry.round_path(line, tolerance=1e-3, curve="parabola")
    job = _job(rng, "pmk3s", {"points": points.tolist()}, limits=_with_jerk(rng))
    return ac.Job(name="curve", arm=job.arm, path=path, servo=job.servo, runs=job.runs)


def _drawing(rng: Random) -> ac.Job:
    """Make a job of a drawing with kerf and leads, cut by an arm under a jerk limit."""
    name, file = DRAWN[int(rng.integers(len(DRAWN)))]
    patch: dict[tuple[str, ...], Any] = {
        ("corners", "tolerance"): float(10 ** rng.uniform(-4, -3.3)),
        ("limits", "joint_jerk"): 2000.0,
    }
    if file == "plate.dxf":
        patch["process", "kerf"] = float(rng.uniform(1e-4, 3e-4))
    return read_cell(name, DRAWINGS / file, patch=patch)


def _woven(rng: Random) -> ac.Job:
    """Make a job of a woven seam, whose drawing is the weave."""
    weave = {
        "width": float(rng.uniform(1e-3, 3e-3)),
        "pitch": float(rng.uniform(3e-3, 6e-3)),
        "speed": float(rng.uniform(3e-3, 8e-3)),
    }
    path = {
        "points": [[0, 0, 0], [0.03, 0, 0]],
        "orientation": {"axis": [0, 0, -1]},
    }
    arm = _in_work_frame("ur5e", rng)
    return _job(rng, arm, path, limits=_with_jerk(rng), process={"weave": weave})


KINDS = {
    "corners in the plane": _corners_in_plane,
    "arcs, ur5e": _arcs_in_space("ur5e"),
    "arcs, fr3": _arcs_in_space("fr3"),
    "follows the tangent": _follows_tangent,
    "arcs without a jerk limit": _arcs_alone,
    "shape free": _shaped,
    "sharp": _sharp,
    "parabola": _curve,
    "drawing": _drawing,
    "weave": _woven,
}
