"""Each result value of a run is one row, which all outputs print."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from tests.cli.test_one_number import PAPER, text_of

import armcontour as ac
from armcontour.core.render import frame, plain
from armcontour.core.result import FIRST, Data, Row
from armcontour.files import parse_job
from armcontour.files.result_folder import to_json
from armcontour.report import render_report
from armcontour.verification import Evaluation

SOURCE = Path(ac.__file__).parent
# Reported values, and the names with which `Row` or `error_rows` creates their rows.
REPORTED_VALUES = {
    "RMS": ("contour_error", "contour_error.rms"),
    "duration": ("duration",),
    "limit use": ("limit_ratios",),
    "clearance": ("low", "clearance", "clearance.low"),
}


@pytest.fixture
def job_result(monkeypatch):
    """Result of a job whose evaluations have the additional row `wobble`."""
    original = Evaluation.to_data

    def to_data(self):
        data = original(self)
        row = Row("wobble", 1.23456e-3, "m", "wobble", "of the tool", FIRST)
        return replace(data, rows=(*data.rows, row))

    monkeypatch.setattr(Evaluation, "to_data", to_data)
    job = PAPER | {"runs": {"optimal": PAPER["runs"]["optimal"]}}
    return ac.run(parse_job(yaml.safe_dump(job)))


def test_a_new_row_appears_in_text_report_table_and_json(job_result):
    (result,) = job_result.runs.values()
    for text in (str(result), str(job_result), text_of(render_report(job_result))):
        assert "wobble" in text and "1.23" in text and "1.234" not in text
    shown = {x["name"].split(".")[-1]: x for x in frame(result.to_data())}["wobble"]
    assert (shown["text"], shown["unit"], shown["note"]) == ("1.23", "mm", "of the tool")
    saved = json.loads(to_json(plain(job_result.to_data())))["runs"]["optimal"]
    assert saved["wobble"] == 1.23456e-3
    assert job_result.figures["optimal"]["wobble"].value == 1.23456e-3


def test_page_does_not_show_lengths_below_a_micrometre():
    note = "rounding 0.2 mm, servo 0.000082 mm, at 0.000500 mm/s"
    shown = frame(Data("run", (Row("off", 8.2e-8, "m", "off", note, FIRST),)))[0]
    assert (shown["text"], shown["unit"]) == ("< 0.001", "mm")
    assert shown["note"] == "rounding 0.2 mm, servo < 0.001 mm, at 0.000500 mm/s"


def modules_that_create(names):
    """Return the modules of the package that call `Row` or `error_rows` with one of the names."""
    modules = set()
    for file in SOURCE.rglob("*.py"):
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(call, ast.Call):
                continue
            if getattr(call.func, "id", "") not in ("Row", "error_rows"):
                continue
            name = call.args[0]
            if isinstance(name, ast.Constant) and name.value in names:
                modules.add(file.relative_to(SOURCE).as_posix())
    return modules


@pytest.mark.parametrize("value", REPORTED_VALUES)
def test_each_reported_value_is_created_in_at_most_three_modules(value):
    """All outputs print the same rows, so a value cannot differ between two outputs."""
    modules = modules_that_create(REPORTED_VALUES[value])
    assert 0 < len(modules) <= 3, sorted(modules)
