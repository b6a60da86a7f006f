"""Contouring with industrial robot arms.

    Path --round_corners--> Path --trace--> JointPath --plan--> Trajectory --compensate-->
    SetPoints --simulate--> Execution --evaluate--> Evaluation

Each arrow is one function of this package; `run(job)` is all of them at once. Names are loaded when
they are first used, so that importing the package costs nothing.
"""

from armcontour.core.lazy import lazy_names

# The public names by their modules; `tools/stubs.py` writes them for type checkers.
_HOME = {
    "batches": "Batch BatchProgress batch",
    "control.compensation": "CompensationOptions Inverse InverseDynamics NoCompensation "
    "PolePlacement compensate",
    "control.compensation.poles": "fastest_poles",
    "control.identification": "BodyFit BodyIdentification Identification ServoFit identify "
    "identify_bodies",
    "control.learning": "LearningResult LearningRun Recording learn",
    "core.errors": "ArmContourError Collision CompensationError ExecutionError InvalidInput "
    "NotRealizable Unreachable",
    "core.frames": "Frame",
    "files": "read_job read_trajectory",
    "files.drawings.read_options": "ReadOptions",
    "files.drawings.read": "read_path",
    "files.exports": "CsvFormat McapFormat NpzFormat RosYamlFormat TemplateFormat URScriptFormat "
    "export",
    "files.exports.resampling": "interpolate_set_points",
    "files.log_file": "read_log",
    "files.robots.loading": "arm_names load_arm",
    "files.robots.options": "ArmOptions",
    "geometry": "Arc Line Orientation Path RoundedPath SegmentLimits ShapedPath",
    "jobs": "CertificateGoal Job JobResult PlaceSearch Rounding Run run",
    "motion": "Execution JointPath Log SetPoints Trajectory dwell_law",
    "planning": "Conventional Explanation Optimal Paper PlanOptions Shaped explain plan shape",
    "planning.tracing": "trace",
    "program": "Analog Contour Dwell Event Lead Pierce Process Program Rapid Switch Tabs Weave "
    "prepare round_corners smooth_curvature",
    "report": "write_report",
    "robot": "Arm Limits Payload PlanarTwoLink SerialArm",
    "robot.scene": "Obstacle Scene",
    "robot.servo": "ServoModel",
    "simulation": "Plant RigidBodyPlant ServoPlant simulate",
    "studies.certification": "Certificate certify sweep",
    "studies.placement": "Placement place",
    "verification": "Check CommandCheck Evaluation LimitUse check check_commands evaluate",
    "verification.clearance": "Cell Clearance check_clearance",
    "_version": "__version__",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    """The public names."""
    return __all__
