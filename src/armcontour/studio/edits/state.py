"""What an edit is made on, and places in the picture that it names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.text import show
from armcontour.studio.handles import Handles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EditState:
    """What an edit is made on.

    Args:
        data: The data of the job file, as written.
        run: The name of the run that is shown.
        handles: What can be grabbed of the job.
    """

    data: Mapping[str, Any]
    run: str
    handles: Handles


def uv_of(name: str, value: Any) -> FloatArray:
    """A place in the picture [m], (2,).

    Args:
        name: Its name in the edit.
        value: What the edit has there.

    Raises:
        InvalidInput: They are no two coordinates.
    """
    found = checks.check_numbers(name, value, "m")
    if found.shape != (2,):
        raise InvalidInput(f"{name} must be two coordinates in the picture, not {show(value)}.")
    return found
