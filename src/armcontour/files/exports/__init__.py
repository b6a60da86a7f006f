"""Export of joint set-points and events to tables and to the formats of robot controllers."""

from armcontour.files.exports.formats import (
    CsvFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
    export,
)
from armcontour.files.exports.ros import GoalTolerances, predict_tolerances
from armcontour.files.exports.table import SetPointTable, make_table

__all__ = [
    "CsvFormat",
    "GoalTolerances",
    "RosYamlFormat",
    "SetPointTable",
    "TemplateFormat",
    "URScriptFormat",
    "export",
    "make_table",
    "predict_tolerances",
]
