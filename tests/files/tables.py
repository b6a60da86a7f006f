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
    """Read a log from CSV text, with the options of `read_log`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "log.csv"
        file.write_text(text)
        return read_log(file, **options)


def rows(table):
    """Split a table into rows and cells: a row is a line, and ` => ` separates cells."""
    return [[x.strip() for x in line.split("=> ")] for line in table.strip().splitlines()]


def refusals(call, table, *begin, kind=InvalidInput, without="\n"):
    """Check that `call` refuses the argument of every row, with an error of one sentence.

    - `table`: rows of an argument and words of the message. ` ... ` between words stands for any
      text. A string has a row per line, such as `speed: 5 kg => limits.speed ... unit`.
    - `begin`: words of all messages.
    - `without`: text that no message may contain.
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
    """Return the value at a place such as runs.one.limits.speed: fields, keys, or named items."""
    for name in str(place).split("."):
        if isinstance(value, tuple) and not hasattr(value, name):
            value = value[int(name)] if name.isdigit() else next(x for x in value if x.name == name)
        else:
            value = value[name] if isinstance(value, dict) else getattr(value, name)
    return value


def values(read, table):
    """Check that `read` returns the expected values for the argument of every row.

    - `table`: a row per line, such as `overlap: 2 mm => {overlap: 0.002}`: an argument, and a
      mapping from places in the result to their values.
    """
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
    """Return the text of a job with changed data."""
    return write_data(text, change_data(load(text, "job"), changes))
