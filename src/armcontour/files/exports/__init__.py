"""Export of joint set-points and events to tables and to the formats of robot controllers."""

from armcontour.files.exports.formats import (
    CsvFormat,
    McapFormat,
    NpzFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
    export,
)
from armcontour.files.exports.resampling import interpolate_set_points
from armcontour.files.exports.ros import GoalTolerances, predict_tolerances
from armcontour.files.exports.table import SetPointTable, make_table

__all__ = [
    "CsvFormat",
    "GoalTolerances",
    "McapFormat",
    "NpzFormat",
    "RosYamlFormat",
    "SetPointTable",
    "TemplateFormat",
    "URScriptFormat",
    "export",
    "interpolate_set_points",
    "make_table",
    "predict_tolerances",
]
