"""Tables of valid and refused inputs: one row per line, one test per table."""

import tempfile
from pathlib import Path

import numpy as np
import yaml

from armcontour.core.errors import InvalidInput
from armcontour.core.yaml_loader import load
from armcontour.files.job_text_edits import change_data, write_data
from armcontour.files.log_file import read_log


def parse_log(text, **options):
    """The log in CSV text; options as of `read_log`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        file.write_text(text)
        return read_log(file, **options)


def rows(table):
    """The cells of the rows of a text, a row a line and ` => ` between cells."""
    return [[x.strip() for x in line.split("=> ")] for line in table.strip().splitlines()]


def refusals(call, table, *begin, kind=InvalidInput, without="\n"):
    """All rows of a table, (argument, words of the message), have to be refused in one sentence.

    Words are text with ` ... ` between parts; all messages have those of `begin` and not `without`.
    """
    faults = []
    for argument, *words in rows(table) if isinstance(table, str) else table:
        parts = [y for x in words for y in x.split(" ... ")]
        try:
            result = call(argument)
        except Exception as error:
            text = str(error)
            lacking = [x for x in (*begin, *parts) if x not in text]
            wrong = not isinstance(error, kind) or without in text or "\n" in text
            if lacking or wrong or text[-1] not in ".?)":
                faults.append(f"{str(argument)[:99]!r}: {lacking} not in {error!r:.500}")
        else:
            faults.append(f"{str(argument)[:99]!r} is accepted: {result!r:.99}")
    assert not faults, "\n".join(faults)


def value_at(value, place):
    """The value at a place such as runs.one.limits.speed: names of fields, keys, items."""
    for name in str(place).split("."):
        if isinstance(value, tuple) and not hasattr(value, name):
            value = value[int(name)] if name.isdigit() else next(x for x in value if x.name == name)
        else:
            value = value[name] if isinstance(value, dict) else getattr(value, name)
    return value


def values(read, table):
    """All rows of a table, (argument, mapping of places to values), have to be read so."""
    faults = []
    for argument, expected in rows(table):
        result = read(argument)
        for place, value in yaml.safe_load(expected).items():
            x = value_at(result, place)
            numbers = type(value) in (int, float, list)
            same = np.shape(x) == np.shape(value) if numbers else bool(np.all(x == value))
            if not same or (numbers and not np.allclose(x, value, rtol=1e-12, atol=1e-15)):
                faults.append(f"{argument}: {place} is {x!r}, not {value!r}")
    assert not faults, "\n".join(faults)


def change_text(text, changes):
    """The text of a job with changes of its data."""
    return write_data(text, change_data(load(text, "job"), changes))
