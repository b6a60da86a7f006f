"""Limits for tests that choose all limits themselves."""

from __future__ import annotations

import math
from typing import Any

import armcontour as ac
from armcontour.arms.limits import JOINT_LIMITS, TOOL_LIMITS


def only_limits(**limits: Any) -> ac.Limits:
    """The given limits; all others are lifted, except the ranges of the arm's joints."""
    return ac.Limits(**(dict.fromkeys((*JOINT_LIMITS, *TOOL_LIMITS), math.inf) | limits))
