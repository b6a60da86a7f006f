"""Writers of joint set-points and events in the formats of robot controllers and of tables."""

from armcontour.io.exports.exporting import export
from armcontour.io.exports.formats import (
    CsvFormat,
    McapFormat,
    NpzFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
)
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.text import csv_text

__all__ = [
    "CsvFormat",
    "McapFormat",
    "NpzFormat",
    "RosYamlFormat",
    "Table",
    "TemplateFormat",
    "URScriptFormat",
    "csv_text",
    "export",
    "make_table",
]
