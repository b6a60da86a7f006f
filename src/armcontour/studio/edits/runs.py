"""Runs of the job that are added and removed."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.text import show
from armcontour.files.job_edits import Change


def add_run(data: Mapping[str, Any], name: str, like: Any) -> list[Change]:
    """Changes that add a run.

    Args:
        data: The job.
        name: Name of the new run.
        like: Name of the run that it is a copy of.

    Raises:
        InvalidInput: The name is taken, or there is no run to copy.
    """
    runs = data.get("runs") or {}
    if name in runs:
        raise InvalidInput(f"The job has a run {name} already.")
    if like not in list(runs):
        raise InvalidInput(f"The job has no run {show(like)}.")
    return [Change(("runs", name), deepcopy(runs[like]))]


def remove_run(data: Mapping[str, Any], name: str) -> list[Change]:
    """Changes that remove a run and the keys that name it.

    Args:
        data: The job.
        name: Name of the run.

    Raises:
        InvalidInput: There is no such run, or no other one.
    """
    runs = data.get("runs") or {}
    if name not in runs:
        raise InvalidInput(f"The job has no run {name}.")
    if len(runs) == 1:
        raise InvalidInput(f"{name} is the only run, and a job needs one.")
    changes, experiment = [Change(("runs", name))], data.get("experiment") or {}
    if name in (experiment.get("runs") or []):
        changes.append(Change(("experiment", "runs", experiment["runs"].index(name))))
    for key in ("certificate", "placement"):
        if (data.get(key) or {}).get("run") == name:
            changes.append(Change((key, "run")))
    return changes
