"""Data as JSON: arrays as lists, and null for numbers that are not finite."""

from __future__ import annotations

import json
from typing import Any

from armcontour.core import render
from armcontour.core.result import Data


def to_json(data: Any) -> str:
    """The text of a file with data, which people read as well as programs."""
    return json.dumps(render.jsonable(data), indent=2, allow_nan=False) + "\n"


def data_json(data: Data) -> str:
    """A result as the text of a file, in SI units.

    Args:
        data: What the result says.
    """
    return to_json(render.plain(data))
