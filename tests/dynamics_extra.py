"""Skip tests that need the extra `dynamics`: pinocchio, and coal for clearance."""

from importlib.util import find_spec
from typing import Any

import pytest

REASON = "needs pip install 'armcontour[dynamics]'"

needs_dynamics = pytest.mark.skipif(find_spec("coal") is None, reason=REASON)


def pinocchio() -> Any:
    """The module pinocchio; skips the calling test or file without it."""
    return pytest.importorskip("pinocchio", reason=REASON)
