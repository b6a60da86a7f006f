"""Readers and writers of user files, which convert all units to SI units."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "armcontour.core.errors": "FileError",
    "exports.export_table": "set_point_pieces write_planned write_set_points write_torque",
    "job_file": "cell_text json_schema parse_job read_job",
    "limits_and_servo_files": "read_limits",
    "mesh_file": "read_mesh",
    "job_patch": "parse_set",
    "certificate_and_placement_files": "certificate_page placed_job_text placement_csv",
    "result_folder": "ResultFolder to_json",
    "trajectory_file": "parse_trajectory read_trajectory",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
