"""Public names: those of `armcontour`, and those of the package that owns them."""

from importlib import import_module

import armcontour as ac

# Results, formats of exports, parts of a process, and base classes.
OWNED = {
    "control.compensation": "CompensationOptions",
    "control.identification": "Identification",
    "control.learning": "LearningResult LearningRun Recording",
    "controllers": "Chunk LinuxCNC Motion Played PlayedMotion RollingRows",
    "files.exports": "CsvFormat McapFormat RosYamlFormat TemplateFormat URScriptFormat",
    "geometry": "Orientation RoundedPath ShapedPath",
    "jobs": "JobResult",
    "planning": "Explanation PlanOptions",
    "program": "Analog Lead Pierce Switch Tabs Wait Weave smooth_curvature",
    "simulation": "Plant",
    "studies.certification": "Certificate",
    "studies.placement": "Placement",
    "verification": "Check InterpolationCheck Evaluation LimitUse check_interpolation",
    "verification.clearance": "Cell Clearance",
}
# By name, without the version.
PUBLIC = {name: getattr(ac, name) for name in ac.__all__ if name != "__version__"}
for package, names in OWNED.items():
    module = import_module(f"armcontour.{package}")
    PUBLIC |= {name: getattr(module, name) for name in names.split()}
