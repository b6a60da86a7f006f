"""Writers of joint set-points and events in the formats of robot controllers and of tables."""

from armcontour.io.exports.exporting import (
    WITH_ANALOG,
    chosen_format,
    export,
    formats,
    refuse_unknown_outputs,
    write_table,
)
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.template import templates
from armcontour.io.exports.text import csv_text

__all__ = [
    "WITH_ANALOG",
    "Table",
    "chosen_format",
    "csv_text",
    "export",
    "formats",
    "refuse_unknown_outputs",
    "make_table",
    "templates",
    "write_table",
]
