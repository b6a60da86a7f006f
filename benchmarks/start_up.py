"""`armcontour --help` against importing numba and scipy.interpolate."""

from __future__ import annotations

import subprocess
import sys

from benchmarks.measured import Measured, paired


def measure() -> list[Measured]:
    """Whole processes, with their files in the system's cache."""

    def ours() -> None:
        subprocess.run(
            [sys.executable, "-m", "armcontour", "--help"], check=True, capture_output=True
        )

    def peer() -> None:
        code = "import numba, scipy.interpolate"
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)

    times = paired(ours, peer, 7)
    return [Measured("armcontour --help", times[0], "import numba, scipy", times[1], "< 0.25")]
