"""Export of joint set-points and events to tables and to the formats of robot controllers."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "formats": "CsvFormat McapFormat RosYamlFormat TemplateFormat URScriptFormat",
    "exporting": "export",
    "ros": "GoalTolerances predict_tolerances",
    "export_table": "SetPointTable make_table",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
