"""Modules that are loaded at first use, and misspelt names."""

import subprocess
import sys

import pytest

import armcontour
from armcontour import io, robustness


def test_every_name_is_there_and_kept():
    for package in (armcontour, io, robustness):
        for name in package.__all__:
            assert getattr(package, name) is vars(package)[name]
        with pytest.raises(AttributeError, match=f"'{package.__name__}' has no attribute 'no_na"):
            _ = package.no_name


def test_a_plan_without_limits_of_jerk_loads_nothing_of_them():
    code = """if True:
        import sys
        import armcontour as ac
        from armcontour.robustness.box import Box
        arm = ac.load_arm("pmk3s")
        ac.plan(ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]]), arm, arm.limits.replace(speed=0.1))
        print(*(x for x in sys.modules if x.startswith("armcontour.")))
    """
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    assert "armcontour.timing.jerk.task" in loaded.split()
    for name in ("timing.jerk.limiting", "timing.jerk._interior_point", "robustness.monte_carlo"):
        assert f"armcontour.{name}" not in loaded.split()
