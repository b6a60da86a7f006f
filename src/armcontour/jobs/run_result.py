"""`RunResult`: the result of a run with its rows and notes; `JobResult`: the results of a job."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

from armcontour.core.fields import checked
from armcontour.core.guesses import Explained
from armcontour.core.pictures import Pictured
from armcontour.core.render import Result, compare, lay_out
from armcontour.core.result import Data
from armcontour.core.text import LINE_WIDTH, short_repr
from armcontour.core.validity import AS_MODELLED
from armcontour.jobs import rows, run_notes
from armcontour.jobs.job import Job
from armcontour.jobs.run_record import RunRecord


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult(RunRecord, Result, Pictured):
    """Result of one run in a job: its plan, its set-points, their execution and its evaluation.

    Args:
        run: The run.
        objective: The program with sharp corners; a path becomes a program.
        path: The program that the tool follows: with rounded or shaped corners, if the run rounds
            corners.
        trajectory: The realizable trajectory.
        traced: Joint paths of all moves, if known.
        clearance: Planned clearance of the arm from itself and its cell; None for an arm with
            unknown shapes.
        avoided: Sentences on other joint paths that were taken to avoid collisions; without a
            clearance, on why it is not checked.
        explanation: Active limits along the path, for a plan of the method "optimal".
        set_points: The set-points; None only for the plan of `plan_one`.
        servo: The servo model of the compensation.
        execution: The executed motion; None without a simulation.
        evaluation: Errors of the executed motion; None without a simulation.
        expected: Errors to expect of the robot, if its servo was identified from logs.
        unknown_gains: Estimated contour error of the worst robot whose gains differ by 1 %, or by
            the spread of the servo; None with `expected`, for joints without gains, without a
            simulation that judges, if such a robot cannot be simulated, and for contours shorter
            than a cycle.
        executed_clearance: Clearance of the arm from itself and its cell, as executed.
        experiment: Result on rigid bodies, if the run has an experiment that did not fail.
        failure: The error of a failed experiment.
        advice: Suggested changes; None if they were not computed.
        resumption: Configuration in which a resumed job begins; None if it is not resumed.
        command_velocity: Constraint of the set-point velocity with which the motion was planned;
            None if a plan without it does not exceed it.
        program: Points of the programs whose controllers plan the motion between them, such as kuka
            and abb; None if the job exports none. If a job exports only such programs, the run has
            neither compensation nor simulation, and the set-points are those of the plan.
    """

    def to_data(self) -> Data:
        """Return the verdict on the run, its values, tables, notes and warnings."""
        return self.data()

    def data(self, job: Job | None = None) -> Data:
        """Return the data of the run, with values of the job's process if the job is given."""
        return rows.run_data(self, job, self.warnings, self.remarks)

    __repr__ = short_repr

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about deviations of the result from the request, without the run's name."""
        return tuple(filter(None, run_notes.warnings(self)))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes about plan and execution that are not warnings, with the name of the run."""
        return tuple(f"Run {self.run.name}: {x}" for x in run_notes.remarks(self))


@dataclass(frozen=True, kw_only=True, eq=False)
class JobResult(Explained, Pictured):
    """A job and the results of its runs.

    Args:
        job: The job.
        runs: The results, by the names of the job's runs; without executions if the job was not
            simulated.
    """

    job: Job
    runs: Mapping[str, RunResult]

    @property
    def simulated(self) -> bool:
        """True if any run was simulated."""
        return any(x.execution is not None for x in self.runs.values())

    @cached_property
    def figures(self) -> dict[str, Data]:
        """Data of each run by name, for the terminal, the summary and reports."""
        return {name: x.data(self.job) for name, x in self.runs.items()}

    @checked
    def to_data(self, parts: Mapping[str, Data] = MappingProxyType({})) -> Data:
        """Return the data of the job, its arm and its runs, for the summary of a result.

        Args:
            parts: Further parts of the summary by key.
        """
        warnings = warnings_of(self.runs.values())
        return rows.job_data(self.job, self.simulated, self.figures, warnings, parts)

    def __str__(self) -> str:
        """Write a table with a row for every run, and what the result does not prove."""
        data = self.to_data()
        title = f"{data.title}, {AS_MODELLED}" if self.simulated else data.title
        table = lay_out(title, compare(data.parts["runs"].parts))
        return "\n".join([table, *textwrap.wrap(data.not_proven, LINE_WIDTH)])

    __repr__ = short_repr


def warnings_of(plans: Iterable[RunResult]) -> tuple[str, ...]:
    """List the warnings of several runs with the names of the runs; equal ones are merged."""
    messages: dict[str, list[str]] = {}
    for plan in plans:
        for sentence in plan.warnings:
            messages.setdefault(sentence, []).append(plan.run.name)
    return tuple(
        f"Run{'s' if len(names) > 1 else ''} {', '.join(names)}: {sentence}"
        for sentence, names in messages.items()
    )
