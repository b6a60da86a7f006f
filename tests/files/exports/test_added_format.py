"""A new export format needs one function and one class; all parts of the package support it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from armcontour.cli.job_options import JOB_OPTIONS
from armcontour.files.exports.formats import ENDINGS


@pytest.fixture(scope="module")
def facts():
    command = [sys.executable, "-m", "tests.files.exports.added_format"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, encoding="utf-8")
    return json.loads(done.stdout.splitlines()[-1])


def test_export_finds_the_added_format_by_extension_and_by_name(facts):
    assert facts["by extension"] == facts["by name"] == facts["set-points"]
    assert facts["same"]


def test_jobs_and_commands_write_the_added_format(facts):
    assert facts["from job"] == facts["from option"] == ["reference.deg", "set_points.deg"]
    assert facts["from result"][1] == 2


def test_messages_and_form_list_the_added_format(facts):
    assert facts["listed"]
    assert ["degrees", "degrees (.deg)", None, True] in facts["form"]


def test_the_help_of_the_option_lists_all_formats():
    (option,) = (x for x in JOB_OPTIONS.values() if x.name == "--export")
    assert option.help.startswith(f"Formats: {', '.join(ENDINGS)}, or a template")
