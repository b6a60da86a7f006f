"""Helpers for tables of test cases, and short forms of lines, arcs and refusals."""

import numpy as np
import pytest

import armcontour as ac


def each(names, table):
    """Run a test for every row of a table, each as one case."""
    return pytest.mark.parametrize(names, list(table))


def refused(*rows, kind=ac.InvalidInput):
    """Check that the calls in all rows, (call, *words, data), are refused in one sentence.

    The message must contain the words, and the attributes of the error the data.
    """
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
    """Return a line with its own limits, such as `speed`."""
    return ac.Line(start=start, end=end, segment_limits=ac.SegmentLimits(**segment_limits))


def arc(start, center, angle, **values):
    return ac.Arc(start=start, center=center, angle=angle, **values)


def path_of(*segments):
    """Return the path of lines and arcs."""
    return ac.Path(segments=segments)


def jumps(path, order=2):
    """Return the jumps of a derivative at inner vertices, relative to its largest length."""
    n = np.arange(len(path))
    ends, starts = (path.on_segment(n, x, order) for x in (path.lengths, 0 * path.lengths))
    size = max(np.abs(ends).max(), np.abs(starts).max(), 1e-9)
    return np.linalg.norm(ends[:-1] - starts[1:], axis=1) / size
