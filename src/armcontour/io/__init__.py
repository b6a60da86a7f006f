"""User files: the only room that knows units other than SI."""

from armcontour.io.certificate import certificate_json, held_csv, sweep_json
from armcontour.io.job_file import json_schema, parse_job, read_job
from armcontour.io.job_overrides import JobOverrides
from armcontour.io.limits_file import read_limits
from armcontour.io.motion_csv import planned_csv, taught_csv, torque_csv
from armcontour.io.results import ResultFolder
from armcontour.io.summary import summarise_taught, summary
from armcontour.io.trajectory_file import TrajectoryFile, parse_trajectory, read_trajectory

__all__ = [
    "JobOverrides",
    "ResultFolder",
    "TrajectoryFile",
    "certificate_json",
    "held_csv",
    "json_schema",
    "parse_job",
    "parse_trajectory",
    "planned_csv",
    "read_job",
    "read_limits",
    "read_trajectory",
    "summary",
    "sweep_json",
    "taught_csv",
    "summarise_taught",
    "torque_csv",
]
