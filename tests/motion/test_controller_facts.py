"""Facts of controllers: each value has a unit and a source, and other modules agree with them."""

import pytest

from armcontour.controllers import Franka, LinuxCNC, Ur
from armcontour.core.errors import InvalidInput
from armcontour.files.exports.formats import FORMATS
from armcontour.files.exports.template import BUILT_IN
from armcontour.motion.controller_facts import (
    all_facts,
    facts_of_format,
    facts_of_player,
    read_facts,
)

FACT = """
ur:
  title: A robot
  facts:
    - sets: cycle
      value: 0.002
      unit: s
      text: It reads a set-point per cycle.
      evidence: READ
      source: a manual
"""


def test_a_fact_sets_the_value_of_its_field():
    (facts,) = read_facts(FACT, "facts")
    assert (facts.name, facts.cycle, facts.effect) == ("ur", 0.002, "unknown")
    (fact,) = facts.facts
    assert (fact.sets, fact.evidence, fact.source) == ("cycle", "READ", "a manual")


@pytest.mark.parametrize(
    "right, wrong",
    [
        ("      unit: s\n", ""),
        ("unit: s", "unit: ms"),
        ("      source: a manual\n", ""),
        ("source: a manual", "source: ''"),
        ("      evidence: READ\n", ""),
        ("READ", "CERTAIN"),
        ("    - sets: cycle\n      value", "    - value"),
        ("      value: 0.002\n", ""),
        ("value: 0.002", "value: -1"),
        ("sets: cycle", "sets: period"),
        ("cycle\n      value: 0.002\n      unit: s", "effect\n      value: explodes"),
        ("cycle\n      value: 0.002\n      unit: s", "joint_jerk\n      value: 5000"),
        ("title: A robot", "title: A robot\n  cycle: 0.002"),
    ],
)
def test_a_value_without_unit_source_or_evidence_is_refused(right, wrong):
    assert right in FACT
    with pytest.raises(InvalidInput):
        read_facts(FACT.replace(right, wrong), "facts")


def test_every_value_of_a_packaged_controller_has_a_source():
    for facts in all_facts():
        sourced = {x.sets: x for x in facts.facts if x.sets}
        names = ("cycle", "velocity_factor", "acceleration_factor")
        given = {x for x in names if getattr(facts, x) is not None}
        given |= {x for x in ("effect", "law") if getattr(facts, x) != "unknown"}
        assert given <= set(sourced), facts.name
        assert facts.facts, facts.name


def test_names_of_formats_and_players_exist():
    for facts in all_facts():
        assert set(facts.formats) <= set(FORMATS)
        assert facts.player in (None, Franka.name, LinuxCNC.name, Ur.name)
    formats = [x for facts in all_facts() for x in facts.formats]
    assert len(formats) == len(set(formats))


def test_controllers_are_found_by_format_and_by_player():
    assert facts_of_format("urscript") is facts_of_player("ur")
    assert facts_of_format("ros-yaml").name == "ros2_control"
    assert facts_of_player("linuxcnc").cycle is None
    # The controller plans the motion of such a program.
    assert [facts_of_format(x) for x in BUILT_IN] == [None] * len(BUILT_IN)
    assert facts_of_player("nobody") is None


@pytest.mark.parametrize("controller", [Franka, Ur])
def test_play_sends_set_points_at_the_cycle_of_the_facts(controller):
    assert controller.cycle == facts_of_player(controller.name).cycle


def test_limits_of_a_controller_refuse_another_number_of_joints():
    limits = facts_of_player("franka").limits
    assert limits.for_joints(7).joint_jerk.max() == 5000 - 1e-3
    with pytest.raises(InvalidInput, match="7 values"):
        limits.for_joints(6)
