"""Colours, dashes and words of limits, verdicts, runs and layers; free of heavy imports."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import Any

# The page of the Studio reads this file, too.
PALETTE_FILE = FilePath(__file__).with_name("palette.json")
# Colours by theme, dashes [px] and words. Keys of limits are their names in explanations.
PALETTE: dict[str, Any] = json.loads(PALETTE_FILE.read_text("utf-8"))
LIMITS: dict[str, dict[str, Any]] = PALETTE["limits"]
VERDICTS: dict[str, dict[str, Any]] = PALETTE["verdicts"]
LINES: dict[str, str] = PALETTE["lines"]
