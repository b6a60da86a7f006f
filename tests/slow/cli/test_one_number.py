"""A figure has one value wherever it is shown, for all built-in jobs and a drawing."""

from importlib import resources
from pathlib import Path

import pytest
import yaml
from tests.cli.conftest import done
from tests.cli.test_one_number import JOBS, QUICK, check

__all__ = ["done"]
CELL = resources.files("armcontour.files") / "cells" / "ur5e.yaml"
DRAWING = Path(__file__).parents[3] / "examples" / "drawings" / "gasket.dxf"


@pytest.mark.parametrize("name", [x for x in JOBS if x not in QUICK])
def test_a_figure_has_one_value_wherever_it_is_shown(name, done, tmp_path):
    check(JOBS[name], done, tmp_path)


def test_a_drawing_in_a_cell_has_one_value_of_each_figure(done, tmp_path):
    data = yaml.safe_load(CELL.read_text())
    data["path"]["file"] = str(DRAWING)
    check(data, done, tmp_path)
