"""Contouring with industrial robot arms.

    Path --round_corners--> Path --trace--> JointPath --plan--> Trajectory --compensate-->
    TaughtData --execute--> Execution --evaluate--> Evaluation

Each arrow is one function of this package; `run(job)` is all of them at once. Names are loaded when
they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from armcontour._lazy import load_lazily
from armcontour._version import __version__

if TYPE_CHECKING:
    from armcontour.arms import (
        Arm,
        Limits,
        Payload,
        PlanarTwoLink,
        SerialArm,
    )
    from armcontour.batches import Batch, Tally, batch
    from armcontour.certification import Certificate, certify, sweep
    from armcontour.clearance import Cell, Clearance, check_clearance
    from armcontour.compensation import (
        CompensationOptions,
        Inverse,
        InverseDynamics,
        NoCompensation,
        PolePlacement,
        compensate,
    )
    from armcontour.compensation.poles import fastest_poles
    from armcontour.errors import (
        ArmContourError,
        Collision,
        CompensationError,
        ExecutionError,
        InvalidInput,
        NotRealizable,
        Unreachable,
    )
    from armcontour.evaluation import Check, Evaluation, LimitUse, check, evaluate
    from armcontour.execution import Plant, RigidBodyPlant, ServoPlant, execute
    from armcontour.frames import Frame
    from armcontour.geometry import (
        Arc,
        Demand,
        Line,
        Orientation,
        Path,
        RoundedPath,
        ShapedPath,
    )
    from armcontour.identification import (
        BodyFit,
        BodyIdentification,
        Identification,
        ServoFit,
        identify,
        identify_bodies,
    )
    from armcontour.io import read_job, read_trajectory
    from armcontour.io.drawings.options import ReadOptions
    from armcontour.io.drawings.read import read_path
    from armcontour.io.exports import (
        CsvFormat,
        McapFormat,
        NpzFormat,
        RosYamlFormat,
        TemplateFormat,
        URScriptFormat,
        export,
    )
    from armcontour.io.log_file import read_log
    from armcontour.io.robots.loading import arm_names, load_arm
    from armcontour.io.robots.options import ArmOptions
    from armcontour.jobs import Goal, Job, PlaceSearch, Rounding, Run, Study, run
    from armcontour.learning import (
        LearnedRun,
        Lesson,
        Recording,
        learn,
    )
    from armcontour.motion import (
        Execution,
        JointPath,
        Log,
        TaughtData,
        Trajectory,
        stand_still,
    )
    from armcontour.placement import Placement, place
    from armcontour.program import (
        Analog,
        Contour,
        Dwell,
        Event,
        Lead,
        Pierce,
        Process,
        Program,
        Rapid,
        Switch,
        Tabs,
        Weave,
        prepare,
        round_corners,
        smooth_curvature,
    )
    from armcontour.report import write_report
    from armcontour.scene import Obstacle, Scene
    from armcontour.servo import ServoModel
    from armcontour.timing import (
        Conventional,
        Explanation,
        Optimal,
        Paper,
        PlanOptions,
        Shaped,
        explain,
        plan,
        shape,
    )
    from armcontour.tracing import trace

_HOME = {
    "arms": (
        "Arm",
        "Limits",
        "Payload",
        "PlanarTwoLink",
        "SerialArm",
    ),
    "batches": ("Batch", "Tally", "batch"),
    "certification": ("Certificate", "certify", "sweep"),
    "clearance": ("Cell", "Clearance", "check_clearance"),
    "compensation": (
        "CompensationOptions",
        "Inverse",
        "InverseDynamics",
        "NoCompensation",
        "PolePlacement",
        "compensate",
    ),
    "compensation.poles": ("fastest_poles",),
    "errors": (
        "ArmContourError",
        "Collision",
        "CompensationError",
        "ExecutionError",
        "InvalidInput",
        "NotRealizable",
        "Unreachable",
    ),
    "evaluation": ("Check", "Evaluation", "LimitUse", "check", "evaluate"),
    "execution": ("Plant", "RigidBodyPlant", "ServoPlant", "execute"),
    "frames": ("Frame",),
    "geometry": (
        "Arc",
        "Demand",
        "Line",
        "Orientation",
        "Path",
        "RoundedPath",
        "ShapedPath",
    ),
    "identification": (
        "BodyFit",
        "BodyIdentification",
        "Identification",
        "ServoFit",
        "identify",
        "identify_bodies",
    ),
    "io": ("read_job", "read_trajectory"),
    "io.drawings.options": ("ReadOptions",),
    "io.drawings.read": ("read_path",),
    "io.exports": (
        "CsvFormat",
        "McapFormat",
        "NpzFormat",
        "RosYamlFormat",
        "TemplateFormat",
        "URScriptFormat",
        "export",
    ),
    "io.log_file": ("read_log",),
    "io.robots.loading": ("arm_names", "load_arm"),
    "io.robots.options": ("ArmOptions",),
    "jobs": ("Goal", "Job", "PlaceSearch", "Rounding", "Run", "Study", "run"),
    "learning": (
        "LearnedRun",
        "Lesson",
        "Recording",
        "learn",
    ),
    "motion": (
        "Execution",
        "JointPath",
        "Log",
        "TaughtData",
        "Trajectory",
        "stand_still",
    ),
    "placement": ("Placement", "place"),
    "program": (
        "Analog",
        "Contour",
        "Dwell",
        "Event",
        "Lead",
        "Pierce",
        "Process",
        "Program",
        "Rapid",
        "Switch",
        "Tabs",
        "Weave",
        "prepare",
        "round_corners",
        "smooth_curvature",
    ),
    "report": ("write_report",),
    "scene": ("Obstacle", "Scene"),
    "servo": ("ServoModel",),
    "timing": (
        "Conventional",
        "Explanation",
        "Optimal",
        "Paper",
        "PlanOptions",
        "Shaped",
        "explain",
        "plan",
        "shape",
    ),
    "tracing": ("trace",),
}
__getattr__ = load_lazily("armcontour", _HOME)

__all__ = [
    "Analog",
    "Arc",
    "Arm",
    "ArmContourError",
    "ArmOptions",
    "Batch",
    "BodyFit",
    "BodyIdentification",
    "Cell",
    "Certificate",
    "Check",
    "Clearance",
    "Collision",
    "CompensationError",
    "CompensationOptions",
    "Contour",
    "Conventional",
    "CsvFormat",
    "Demand",
    "Dwell",
    "Evaluation",
    "Event",
    "Execution",
    "ExecutionError",
    "Explanation",
    "Frame",
    "Goal",
    "Identification",
    "InvalidInput",
    "Inverse",
    "InverseDynamics",
    "Job",
    "JointPath",
    "Lead",
    "LearnedRun",
    "Lesson",
    "LimitUse",
    "Limits",
    "Line",
    "Log",
    "McapFormat",
    "NoCompensation",
    "NotRealizable",
    "NpzFormat",
    "Obstacle",
    "Optimal",
    "Orientation",
    "Paper",
    "Path",
    "Payload",
    "Pierce",
    "PlaceSearch",
    "Placement",
    "PlanOptions",
    "PlanarTwoLink",
    "Plant",
    "PolePlacement",
    "Process",
    "Program",
    "Rapid",
    "ReadOptions",
    "Recording",
    "RigidBodyPlant",
    "RosYamlFormat",
    "RoundedPath",
    "Rounding",
    "Run",
    "Scene",
    "SerialArm",
    "ServoFit",
    "ServoModel",
    "ServoPlant",
    "Shaped",
    "ShapedPath",
    "Study",
    "Switch",
    "Tabs",
    "Tally",
    "TaughtData",
    "TemplateFormat",
    "Trajectory",
    "URScriptFormat",
    "Unreachable",
    "Weave",
    "__version__",
    "arm_names",
    "batch",
    "certify",
    "check",
    "check_clearance",
    "compensate",
    "evaluate",
    "execute",
    "explain",
    "export",
    "fastest_poles",
    "identify",
    "identify_bodies",
    "learn",
    "load_arm",
    "place",
    "plan",
    "prepare",
    "read_job",
    "read_log",
    "read_path",
    "read_trajectory",
    "round_corners",
    "run",
    "shape",
    "smooth_curvature",
    "stand_still",
    "sweep",
    "trace",
    "write_report",
]


def __dir__() -> list[str]:
    """The public names."""
    return __all__
