"""Writers of joint set-points and events in the formats of robot controllers and of tables."""

from armcontour.io.exports.exporting import (
    HAVE_ANALOG,
    chosen_format,
    export,
    formats,
    refuse_unknown_outputs,
    takes_analog,
    write_table,
)
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.template import describe_program, templates
from armcontour.io.exports.text import csv_text

__all__ = [
    "HAVE_ANALOG",
    "Table",
    "chosen_format",
    "csv_text",
    "describe_program",
    "export",
    "formats",
    "refuse_unknown_outputs",
    "make_table",
    "takes_analog",
    "templates",
    "write_table",
]
