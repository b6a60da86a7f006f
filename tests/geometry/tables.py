"""Helpers for tables of test cases, and short forms of lines, arcs and refusals."""

import functools
import inspect

import numpy as np
import pytest

import armcontour as ac


def each(names, table):
    """Run a test for every row of a table, as one case; a failure names its row."""
    names = [x.strip() for x in names.split(",")] if isinstance(names, str) else names

    def over_rows(test):
        signature = inspect.signature(test)
        fixtures = [x for x in signature.parameters.values() if x.name not in names]

        @functools.wraps(test)
        def run(**fixtures):
            for number, row in enumerate(table):
                values = (row,) if len(names) == 1 else row
                try:
                    test(**fixtures, **dict(zip(names, values, strict=True)))
                except BaseException as fault:
                    fault.add_note(f"row {number} of {', '.join(names)}: {row!r:.500}")
                    raise

        run.__signature__ = signature.replace(parameters=fixtures)
        return run

    return over_rows


def refused(*rows, kind=ac.InvalidInput):
    """All calls of the rows, (call, words, data), have to be refused in one sentence."""
    for number, (call, *words, data) in enumerate(
        row if isinstance(row[-1], dict) else (*row, {}) for row in rows
    ):
        try:
            with pytest.raises(kind) as caught:
                call()
            error = caught.value
            message = str(caught.value)
            assert message.endswith(".") and "\n" not in message
            assert not [x for x in words if x not in message], message
            for name, value in data.items():
                if not isinstance(value, str):
                    value = pytest.approx(value, rel=1e-6, abs=1e-12)
                assert getattr(error, name) == value, name
        except BaseException as fault:
            fault.add_note(f"row {number}: {words}")
            raise


def line(start, end, **segment_limits):
    """A line, with a demand if there are values of one."""
    return ac.Line(start=start, end=end, segment_limits=ac.SegmentLimits(**segment_limits))


def arc(start, center, angle, **values):
    return ac.Arc(start=start, center=center, angle=angle, **values)


def path_of(*segments):
    """The path of some lines and arcs."""
    return ac.Path(segments=segments)


def jumps(path, order=2):
    """Jumps of a derivative at all vertices, over its largest size."""
    n = np.arange(len(path))
    ends, starts = (path.on_segment(n, x, order) for x in (path.lengths, 0 * path.lengths))
    size = max(np.abs(ends).max(), np.abs(starts).max(), 1e-9)
    return np.linalg.norm(ends[:-1] - starts[1:], axis=1) / size
