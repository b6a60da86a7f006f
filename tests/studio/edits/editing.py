"""Jobs that are edited, and their data after an edit."""

from __future__ import annotations

from functools import cache
from typing import Any

from armcontour._yaml import load
from armcontour.io import parse_job
from armcontour.io.job_edits import change_data, change_text
from armcontour.jobs import Job
from armcontour.studio.edits import EditState, changes_of
from armcontour.studio.handles import Handles, handles_of

HEAD = "name: a\narm: {arm}\n"
TAIL = """\
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 4 ms
runs:
  mac: {timing: {method: mac, knots: 600}, compensation: {method: none}}
  own: {limits: {speed: 20 mm/s}, corners: sharp, command_interval: 0.002}
"""
PLANE = HEAD.replace("{arm}", "pmk3s") + (
    "path: {points: [[0.30, 0.20], [360 mm, 20 cm], [0.36, 0.26]]}\n" + TAIL
)
TURNED = PLANE.replace(
    "path: {", "path: {frame: {position: [10 mm, 0.02, 0], rpy: [0, 0, 30 deg]}, "
)
CHAIN = (
    HEAD.replace("{arm}", "pmk3s")
    + """\
path:
  start: [0.30, 0.20]
  segments:
    - {to: [0.36, 0.20], speed: 0.1 m/s}
    - {via: [0.37, 0.21], to: [0.38, 0.20]}
    - {center: [0.38, 0.22], angle: 90 deg}
    - {to: [0.36, 0.26]}
"""
    + TAIL
)
SPACE = (
    HEAD.replace("{arm}", "ur5e")
    + """\
path:
  points: [[0.45, 0.0, 0.2], [500 mm, 0.0, 0.2], [0.50, 0.03, 0.2]]
  frame: {position: [0, 0, 0.05], rpy: [10 deg, -5 deg, 20 deg]}
  orientation: [{rpy: [180 deg, 0, 0]}, {rpy: [3, 0, 0]}, {rpy: [3.1, 0, 0]}]
"""
    + TAIL
)


@cache
def state_of(text: str, run: str = "own") -> EditState:
    data = load(text, "")
    return EditState(data=data, run=run, handles=handles_of(parse_job(text), data))


def edited(text: str, run: str = "own", **edit: Any) -> dict:
    """The data after an edit."""
    changes = changes_of(edit, state := state_of(text, run))
    return change_data(state.data, changes)


def again(text: str, run: str = "own", **edit: Any) -> tuple[Job, Handles]:
    """The job after an edit, and its handles."""
    new = change_text(text, changes_of(edit, state_of(text, run)))
    job = parse_job(new)
    return job, handles_of(job, load(new, ""))
