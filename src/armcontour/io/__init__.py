"""Readers and writers of user files: the only package with units other than SI."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.io.certificate import certificate_json, derating_csv
    from armcontour.io.exports.table import write_planned, write_taught, write_torque
    from armcontour.io.job_file import json_schema, parse_job, read_job
    from armcontour.io.limits_file import read_limits
    from armcontour.io.mesh_file import read_mesh
    from armcontour.io.patch import parse_set
    from armcontour.io.placement import placed_job_text, placement_csv, placement_json
    from armcontour.io.results import ResultFolder
    from armcontour.io.scene_files import read_scene_file
    from armcontour.io.trajectory_file import parse_trajectory, read_trajectory
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "certificate": "certificate_json derating_csv",
            "job_file": "json_schema parse_job read_job",
            "limits_file": "read_limits",
            "mesh_file": "read_mesh",
            "exports.table": "write_planned write_taught write_torque",
            "patch": "parse_set",
            "placement": "placed_job_text placement_csv placement_json",
            "results": "ResultFolder",
            "scene_files": "read_scene_file",
            "trajectory_file": "parse_trajectory read_trajectory",
        },
    )
