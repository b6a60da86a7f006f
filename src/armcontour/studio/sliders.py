"""Which quantities can be set."""

from __future__ import annotations
from collections.abc import Mapping
from typing import Any
from armcontour.jobs import Job


def sliders_of(data: Mapping[str, Any], job: Job, run: str) -> list[dict[str, Any]]:
    return []
