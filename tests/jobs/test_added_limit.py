"""A new limit needs one record and one class; all parts of the package support it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import armcontour as ac
from armcontour.core.render import limit_style
from armcontour.planning.constraints import FROM_LIMITS
from armcontour.planning.explanation import BETWEEN
from armcontour.robot.limit_use import States
from armcontour.robot.limits import LIMITS, WITHOUT_CONSTRAINT

# Name of the limit that `added_limit.py` adds.
NAME = "path_acceleration"
# Its value [m/s²].
LIMIT = 0.1
# Bound of the differences of tool speeds, which are not exact.
ROUNDING = 1e-5


@pytest.fixture(scope="module")
def facts():
    command = [sys.executable, "-m", "tests.jobs.added_limit"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, encoding="utf-8")
    return json.loads(done.stdout)


def test_plans_stops_and_certificates_satisfy_the_added_limit(facts):
    along = facts["along"]
    assert along.pop("free") > 1.5 * LIMIT
    for name in ("planned", "certified", "jerk", "stopped"):
        assert 0.98 * LIMIT < along[name] < LIMIT * (1 + ROUNDING), name


def test_check_and_evaluation_rate_the_added_limit(facts):
    kept = {"planned": "kept", "free": "violated", "samples": "violated"}
    assert facts["checked"] == {**kept, "positions": "cannot tell"}
    assert facts["violations"] == facts["not judged"] == [NAME]
    assert facts["ratio"] == pytest.approx(1, rel=1e-3)


def test_explanation_and_certificate_name_the_added_limit(facts):
    assert max(facts["explained"], key=facts["explained"].get) == "path acceleration"
    assert "path acceleration" in facts["certificate"]


def test_the_player_scales_the_added_limit_and_refuses_a_plan_that_exceeds_it(facts):
    assert facts["slowed"] == pytest.approx(LIMIT / 4, rel=0.01)
    assert facts["refused"] == [NAME, LIMIT]


def test_job_files_and_the_form_of_the_studio_have_the_added_limit(facts):
    assert facts["read"] == LIMIT
    assert facts["form"] == ["m/s²", "Largest acceleration of the tool along the path."]


def test_added_limit_is_not_drawn_like_the_time_between_two_limits(facts):
    assert facts["drawn"] != limit_style(BETWEEN)


def test_every_limit_is_planned_by_a_constraint_or_a_part_of_its_own():
    # Tracing checks the ranges, and a separate planner limits the jerk.
    served = [name for kind in FROM_LIMITS for name in kind.serves]
    assert sorted([*WITHOUT_CONSTRAINT, *served]) == sorted(LIMITS)


@pytest.mark.parametrize(
    ("name", "order"), [("angular_jerk", 3), ("tool_jerk", 3), ("tool_height", 0)]
)
def test_limit_that_no_planner_can_keep_is_refused_when_it_is_declared(name, order):
    program = f"""
from tests.jobs.added_limit import LAST_FIELD, import_changed

record = "    {name}: Annotated[AccelerationLimit | None, Limit({order})] = None\\n"
import_changed("armcontour.robot.limits", {{LAST_FIELD: record}})
"""
    done = subprocess.run([sys.executable, "-c", program], stderr=subprocess.PIPE, encoding="utf-8")
    assert done.returncode == 1
    assert "InvalidInput" in done.stderr and f"{name} has order {order}" in done.stderr


def test_every_limit_has_a_label_a_unit_and_a_measure():
    arm = ac.load_arm("ur5e")
    states = States(arm, [arm.limits.middle(6)[None] + 0.1 * k for k in range(4)])
    for name, limit in LIMITS.items():
        assert limit.name == name and limit.label and limit.unit and limit.power is not None
        values, error = states.measure(name)
        assert values.shape == ((1, 6) if limit.kind == "joint" else (1,))
        assert not error.any()
