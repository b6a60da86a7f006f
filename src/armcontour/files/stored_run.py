"""Read a run from the folder of a result: its set-points, its plan and its events."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.text import list_some
from armcontour.files.exports.table import (
    Table,
    are_places,
    check_export_cycle,
    differentiate,
    regular_times,
    tabulate,
)
from armcontour.files.joint_table import TrajectoryFile
from armcontour.files.results import SUMMARY, verify_file
from armcontour.files.trajectory_file import read_trajectory
from armcontour.motion import Samples, TimedEvent

# Times this near to each other are the same, in cycles: they are printed with 12 digits.
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredRun:
    """A run of a result folder, of `run`, `demo`, `certify` or `learn`.

    Args:
        folder: The result folder.
        name: Name of the run.
        title: Name of the job.
        joint_names: Names of the joints.
        cycle: Cycle, which is also the time between rows of the plan [s].
        events: Events with their times from the start of the plan.
        analog: Names of analog outputs, whose values a result does not have.
        plain: Whether set-points are those of the plan, without compensation.
    """

    folder: FilePath
    name: str
    title: str
    joint_names: tuple[str, ...]
    cycle: float
    events: tuple[TimedEvent, ...]
    analog: tuple[str, ...] = ()
    plain: bool = False

    def set_points(self, **options: Any) -> Table:
        """The table of the set-points.

        Args:
            options: `arm`, `derivatives` and `tool_motion`, as in `make_table`.

        Raises:
            InvalidInput: The file is missing or was changed, or as in `make_table`.
        """
        found = self._read("set_points.csv")
        start = float(found.t[0])
        return tabulate(
            self._set_points(found, options.get("derivatives", 2)),
            name=f"{self.title} set-points",
            cycle=self.cycle,
            events=tuple(x.shifted(-start) for x in self.events),
            start_time=start,
            joint_names=self.joint_names,
            **options,
        )

    def reference(self, cycle: float | None = None, **options: Any) -> Table:
        """The table of the plan, every `cycle`.

        Args:
            cycle: Time between samples [s], a whole multiple of the cycle, as the
                result has no times between; the cycle by default.
            options: As in `set_points`.

        Raises:
            InvalidInput: The file is missing or was changed, the cycle is no multiple or longer
                than the motion, or as in `make_table`.
        """
        step = self.cycle if cycle is None else cycle
        every = round(step / self.cycle)
        if every < 1 or abs(step - every * self.cycle) > 1e-9 * step:
            least = max(1, int(step / self.cycle)) * self.cycle
            raise InvalidInput(
                f"The result in {self.folder} has the plan every {self.cycle * 1e3:g} ms, so the "
                f"cycle must be a multiple of that, such as {least * 1e3:g} ms, and not "
                f"{step * 1e3:g} ms.",
                needed=step,
                allowed=least,
            )
        found = self._read("planned.csv")
        if found.dq is None or found.ddq is None:
            raise InvalidInput(f"{found.source} has no velocities and accelerations.")
        check_export_cycle(step, float(found.t[-1]), f"{self.title} reference")
        rows = np.unique(np.append(np.arange(0, len(found.t), every), len(found.t) - 1))
        return tabulate(
            Samples(t=found.t[rows], q=found.q[rows], dq=found.dq[rows], ddq=found.ddq[rows]),
            name=f"{self.title} reference",
            cycle=step,
            events=self.events,
            joint_names=self.joint_names,
            **options,
        )

    def _set_points(self, set_points: TrajectoryFile, derivatives: int) -> Samples:
        """Set-points with their derivatives, as `make_table` gives them."""
        if not self.plain or derivatives < 2:
            return differentiate(set_points.q, self.cycle)
        plan = self._read("planned.csv")
        if plan.dq is None or plan.ddq is None or not are_places(set_points.q, plan.q):
            return differentiate(set_points.q, self.cycle)
        dq, ddq = plan.dq.copy(), plan.ddq.copy()
        if abs(plan.t[-1] - set_points.t[-1]) > SAME_TIME * self.cycle:
            # The plan ends between the last two set-points, and rests at the last one.
            dq[-1], ddq[-1] = 0.0, 0.0
        return Samples(t=regular_times(len(dq), self.cycle), q=set_points.q, dq=dq, ddq=ddq)

    def _read(self, name: str) -> TrajectoryFile:
        """Read a file of the run that did not change since it was written."""
        return read_trajectory(verify_file(self.folder, f"{self.name}/{name}"), self.joint_names)


def read_run(folder: str | FilePath, name: str | None = None) -> StoredRun:
    """Read a run of a result folder.

    Args:
        folder: Folder of a result.
        name: Name of the run; not needed if there is one run only.

    Raises:
        InvalidInput: No result, no such run, or files that were changed.
    """
    place = FilePath(folder)
    file = verify_file(place, SUMMARY)
    try:
        data = json.loads(read_text(file, "summary"))
        run = _choose(place, data["runs"], name)
        about = data["runs"][run]
        return StoredRun(
            folder=place,
            name=run,
            title=data["job"],
            joint_names=tuple(data["arm"]["joints"]),
            cycle=about["cycle"],
            events=tuple(_event(x) for x in about.get("events", ())),
            analog=tuple(about.get("analog", ())),
            plain=about.get("compensation") == "none",
        )
    except InvalidInput:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidInput(
            f"{file} is not the summary of a run or a certificate: {type(error).__name__}."
        ) from None


def _event(x: Mapping[str, Any]) -> TimedEvent:
    """An event of a summary."""
    return TimedEvent(
        name=x["name"],
        value=x["value"],
        t=x["t"],
        due=x["due"],
        s=x["s"],
        point=tuple(x["point"]),
    )


def _choose(folder: FilePath, runs: Mapping[str, Any], name: str | None) -> str:
    """The name of the wanted run, or of the only one."""
    known = list_some([repr(x) for x in runs], 6)
    if name is None and len(runs) == 1:
        return next(iter(runs))
    if name is None:
        raise InvalidInput(f"{folder} has the runs {known}: choose one with --run.")
    if name not in runs:
        raise InvalidInput(f"{folder} has no run {name!r}: its runs are {known}.")
    return name
