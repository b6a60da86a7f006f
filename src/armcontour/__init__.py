"""Contouring with industrial robot arms.

    Path --round_corners--> Path --trace--> JointPath --plan--> Trajectory --compensate-->
    SetPoints --simulate--> Execution --evaluate--> Evaluation

Each arrow is one function of this package; `run(job)` does all of them. The package has functions
and what their callers construct; results, formats and parts of a process are in the package that
owns them. Names load at their first use. Examples in docstrings use these objects:

>>> import numpy as np
>>> import armcontour as ac
>>> arm = ac.load_arm("pmk3s")
>>> objective = ac.Path.polyline([(0.30, 0.20), (0.33, 0.20), (0.33, 0.23)])
>>> path = ac.round_corners(objective, tolerance=1e-3)
>>> limits = arm.limits.replace(speed=0.1, centripetal_acceleration=0.09)
>>> planned = ac.plan(path, arm, limits)
>>> servo = ac.ServoModel(kp=25.0, kv=150.0)
>>> set_points = ac.compensate(planned, servo)
>>> executed = ac.simulate(set_points, ac.ServoPlant(arm, servo))
>>> ac.evaluate(executed, path, objective=objective).contour_error.max < 1e-4
True
"""

from armcontour.core.lazy import METHODS, lazy_names

# The public names by their modules; `tools/stubs.py` writes them for type checkers.
_HOME = {
    "control.compensation": "Inverse InverseDynamics NoCompensation compensate",
    "control.identification": "ServoFit identify",
    "control.learning": "learn",
    "controllers": "play",
    "core.errors": "ArmContourError Collision CompensationError ExecutionError InvalidInput "
    "NotRealizable Unreachable",
    "core.frames": "Frame",
    "files": "read_job read_trajectory",
    "files.batch": "batch",
    "files.drawings.read_options": "ReadOptions",
    "files.drawings.path_reader": "read_path",
    "files.exports": "export",
    "files.model.cad_model": "read_model",
    "files.log_file": "read_log",
    "files.robots.arm_loading": "arm_names load_arm",
    "geometry": "Arc Line Path SegmentLimits",
    "jobs": "CertificateGoal Job Rounding Run run",
    "motion": "Execution JointPath Log SetPoints Trajectory dwell_law",
    "paper": "Conventional Paper PolePlacement",
    "planning": "Optimal Shaped explain plan shape",
    "planning.tracing": "trace",
    "program": "Contour Dwell Event Process Program Rapid prepare round_corners",
    "report": "write_report",
    "robot": "Arm Limits Payload PlanarTwoLink Positioner PositionerAxis Rail SerialArm",
    "robot.scene": "Obstacle Scene",
    "robot.servo": "ServoModel",
    "simulation": "RigidBodyPlant ServoPlant simulate",
    "studies.certification": "certify",
    "studies.placement": "place",
    "verification": "check evaluate",
    "verification.clearance": "check_clearance",
    "_version": "__version__",
}
METHODS |= {
    "check_formats": "armcontour.files.exports.formats",
    "draw_result": "armcontour.report.notebook",
    "explain": "armcontour.planning.explanation",
    "result_as_html": "armcontour.report.notebook",
    "load_arm": "armcontour.files.robots.arm_loading",
    "program_formats": "armcontour.files.exports.formats",
    "servo_preset": "armcontour.files.servo_presets",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    """The public names."""
    return __all__
