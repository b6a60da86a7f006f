"""Data as JSON: arrays as lists, and null for numbers that are not finite."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from armcontour.core import render
from armcontour.core.result import Data


def to_json(data: Any) -> str:
    """The text of a file with data, which people read as well as programs."""
    return json.dumps(plain(data), indent=2, allow_nan=False) + "\n"


def data_json(data: Data) -> str:
    """A result as the text of a file, in SI units.

    Args:
        data: What the result says.
    """
    return to_json(render.plain(data))


def plain(value: Any) -> Any:
    """A value as JSON has it: lists for arrays, null for numbers that are not finite."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(x) for key, x in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return [plain(x) for x in value]
