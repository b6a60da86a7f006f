"""Contouring with industrial robot arms.

    Path --round_corners--> Path --trace--> JointPath --plan--> Trajectory --compensate-->
    TaughtData --execute--> Execution --evaluate--> Evaluation

Each arrow is one function of this package; `run(job)` is all of them at once. Names are loaded when
they are first used, so that importing the package costs nothing.
"""

from armcontour._lazy import lazy_names

# The public names by their modules; `tools/stubs.py` writes them for type checkers.
_HOME = {
    "arms": "Arm Limits Payload PlanarTwoLink SerialArm",
    "batches": "Batch Tally batch",
    "certification": "Certificate certify sweep",
    "clearance": "Cell Clearance check_clearance",
    "compensation": "CompensationOptions Inverse InverseDynamics NoCompensation PolePlacement "
    "compensate",
    "compensation.poles": "fastest_poles",
    "errors": "ArmContourError Collision CompensationError ExecutionError InvalidInput "
    "NotRealizable Unreachable",
    "evaluation": "Check Evaluation LimitUse check evaluate",
    "execution": "Plant RigidBodyPlant ServoPlant execute",
    "frames": "Frame",
    "geometry": "Arc Demand Line Orientation Path RoundedPath ShapedPath",
    "identification": "BodyFit BodyIdentification Identification ServoFit identify identify_bodies",
    "io": "read_job read_trajectory",
    "io.drawings.options": "ReadOptions",
    "io.drawings.read": "read_path",
    "io.exports": "CsvFormat McapFormat NpzFormat RosYamlFormat TemplateFormat URScriptFormat "
    "export",
    "io.log_file": "read_log",
    "io.robots.loading": "arm_names load_arm",
    "io.robots.options": "ArmOptions",
    "jobs": "Goal Job PlaceSearch Rounding Run Study run",
    "learning": "LearnedRun Lesson Recording learn",
    "motion": "Execution JointPath Log TaughtData Trajectory stand_still",
    "placement": "Placement place",
    "program": "Analog Contour Dwell Event Lead Pierce Process Program Rapid Switch Tabs Weave "
    "prepare round_corners smooth_curvature",
    "report": "write_report",
    "scene": "Obstacle Scene",
    "servo": "ServoModel",
    "timing": "Conventional Explanation Optimal Paper PlanOptions Shaped explain plan shape",
    "tracing": "trace",
    "_version": "__version__",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    """The public names."""
    return __all__
