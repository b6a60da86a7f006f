"""Writers of joint set-points and events in the formats of robot controllers and of tables."""

from armcontour.files.exports.formats import (
    CsvFormat,
    McapFormat,
    NpzFormat,
    RosYamlFormat,
    TemplateFormat,
    URScriptFormat,
    export,
)
from armcontour.files.exports.table import Table, make_table

__all__ = [
    "CsvFormat",
    "McapFormat",
    "NpzFormat",
    "RosYamlFormat",
    "Table",
    "TemplateFormat",
    "URScriptFormat",
    "export",
    "make_table",
]
