"""Readers and writers of user files: the only package with units other than SI."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "certificate": "certificate_json derating_csv",
    "exports.table": "write_planned write_taught write_torque",
    "job_file": "json_schema parse_job read_job",
    "limits_file": "read_limits",
    "mesh_file": "read_mesh",
    "patch": "parse_set",
    "placement": "placed_job_text placement_csv placement_json",
    "results": "ResultFolder",
    "scene_files": "read_scene_file",
    "trajectory_file": "parse_trajectory read_trajectory",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
