"""Writers of joint set-points and events in the formats of robot controllers and of tables."""

from armcontour.io.exports.exporting import export, refuse_unknown_outputs
from armcontour.io.exports.formats import (
    FORMATS,
    WITH_ANALOG,
    WITH_OUTPUTS,
    CsvFormat,
    ExportFormat,
    McapFormat,
    NpzFormat,
    RosYamlFormat,
    TemplateFormat,
    UrScriptFormat,
    format_named,
    format_of,
    formats,
    outputs_of,
)
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.template import describe_program, templates
from armcontour.io.exports.text import csv_text

__all__ = [
    "FORMATS",
    "WITH_ANALOG",
    "WITH_OUTPUTS",
    "CsvFormat",
    "ExportFormat",
    "McapFormat",
    "NpzFormat",
    "RosYamlFormat",
    "Table",
    "TemplateFormat",
    "UrScriptFormat",
    "csv_text",
    "describe_program",
    "export",
    "format_named",
    "format_of",
    "formats",
    "make_table",
    "outputs_of",
    "refuse_unknown_outputs",
    "templates",
]
