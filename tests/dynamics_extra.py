"""Skip tests that need the extra `dynamics`: pinocchio, and coal for clearance."""

from collections.abc import Collection, Iterable
from importlib.util import find_spec

import pytest

REASON = "needs pip install 'armcontour[dynamics]'"

needs_dynamics = pytest.mark.skipif(find_spec("coal") is None, reason=REASON)


def pinocchio():
    """The module pinocchio; skips the calling test or file without it."""
    return pytest.importorskip("pinocchio", reason=REASON)


def mark_all_but(names: Iterable[str], others: Collection[str]):
    """Parameters of a test, of which all but some need the extra."""
    return [x if x in others else pytest.param(x, marks=needs_dynamics) for x in names]
