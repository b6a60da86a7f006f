"""Readers and writers of user files: the only package with units other than SI.

Names are loaded at first use, so that a program that reads an arm does not load the checks of jobs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from armcontour._lazy import load_lazily

if TYPE_CHECKING:
    from armcontour.io.certificate import (
        certificate_json,
        derating_csv,
    )
    from armcontour.io.job_file import json_schema, parse_job, read_job
    from armcontour.io.limits_file import read_limits
    from armcontour.io.mesh_file import read_mesh
    from armcontour.io.motion_csv import write_planned, write_taught, write_torque
    from armcontour.io.patch import parse_set
    from armcontour.io.placement import placed_job_text, placement_csv, placement_json
    from armcontour.io.results import ResultFolder
    from armcontour.io.scene_files import read_scene_file
    from armcontour.io.trajectory_file import parse_trajectory, read_trajectory

_HOME = {
    "certificate": ("certificate_json", "derating_csv"),
    "job_file": ("json_schema", "parse_job", "read_job"),
    "limits_file": ("read_limits",),
    "mesh_file": ("read_mesh",),
    "motion_csv": ("write_planned", "write_taught", "write_torque"),
    "patch": ("parse_set",),
    "placement": ("placed_job_text", "placement_csv", "placement_json"),
    "results": ("ResultFolder",),
    "scene_files": ("read_scene_file",),
    "trajectory_file": ("parse_trajectory", "read_trajectory"),
}
__getattr__ = load_lazily("armcontour.io", _HOME)

__all__ = [
    "ResultFolder",
    "certificate_json",
    "derating_csv",
    "json_schema",
    "parse_job",
    "parse_set",
    "parse_trajectory",
    "placed_job_text",
    "placement_csv",
    "placement_json",
    "write_planned",
    "read_job",
    "read_limits",
    "read_mesh",
    "read_scene_file",
    "read_trajectory",
    "write_taught",
    "write_torque",
]
