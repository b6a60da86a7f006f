"""What is known about controllers that receive set-points: cycle, limits, and interpolation.

The facts, each with its source, are in `controllers.yaml`. Pages and rules for set-points are made
from them. Robot programs between whose points the controller plans the motion (KRL, RAPID) have
none.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from armcontour.core import yaml_loader
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared, quantities
from armcontour.core.quantities import Choice, Factor, Interval, Named
from armcontour.core.text import show
from armcontour.motion.controller_laws import NAMES
from armcontour.robot import Limits

FILE = FilePath(__file__).with_name("controllers.yaml")
# Longest text of a fact or of its sources [characters].
LONGEST_TEXT = 1000
# Laws of controllers without an entry in `controller_laws`.
OTHER_LAWS = ("lines", "cubics", "holds", "unknown")

Effect = Literal["stops", "clamps", "filters", "unknown"]
Evidence = Literal["MEASURED", "READ", "UNVERIFIED"]
Sentence = Annotated[str, Named(LONGEST_TEXT, needed=True)]


@declared()
class Fact(Checked):
    """What one source says about a controller.

    Args:
        text: What it says.
        evidence: "MEASURED" by the source, "READ" in the source, or "UNVERIFIED" if no source
            states it.
        source: The source.
        sets: Name of the field of `ControllerFacts`, or of the limit, whose value it states; "" for
            a fact in words.
    """

    text: Sentence
    evidence: Evidence
    source: Sentence
    sets: str = ""


@declared(eq=False)
class ControllerFacts(Checked):
    """What is known about a controller.

    >>> facts_of_format("ros-yaml").effect
    'clamps'

    Args:
        name: Name, such as "ur".
        title: Name for people.
        formats: Export formats that the controller executes.
        player: Name in `play --on`; None if `play` does not support it.
        cycle: Time between the set-points that it reads [s]; None if the user sets it, or if it is
            unknown.
        limits: Its absolute limits of set-points, one value per joint, or one for all joints.
        velocity_factor: Its velocity limit as a multiple of the plan's; None without one.
        acceleration_factor: Its acceleration limit as a multiple of the plan's; None without one.
        effect: What it does with set-points beyond a limit.
        law: How it interpolates set-points that come less often than it reads them: "lines",
            "cubics", "holds" (the last set-point), a name in `controller_laws.CONTROLLERS`, or
            "unknown".
        facts: What the sources say; all values from `cycle` on come from them.
    """

    name: Annotated[str, Named(needed=True)]
    title: Annotated[str, Named(needed=True)]
    formats: tuple[str, ...] = ()
    player: str | None = None
    cycle: Interval | None = None
    limits: Limits = Limits()
    velocity_factor: Factor | None = None
    acceleration_factor: Factor | None = None
    effect: Effect = "unknown"
    law: Annotated[str, Choice((*OTHER_LAWS, *NAMES))] = "unknown"
    facts: tuple[Fact, ...] = ()


# Units of the limits, and of all values that a fact can set.
LIMIT_UNITS = {name: x.unit for name, x in quantities(Limits).items()}
UNITS = LIMIT_UNITS | {name: x.unit for name, x in quantities(ControllerFacts).items()}


@cache
def all_facts() -> tuple[ControllerFacts, ...]:
    """Return the facts of all controllers."""
    return read_facts(FILE.read_text(encoding="utf-8"), FILE.name)


def facts_of_format(name: str) -> ControllerFacts | None:
    """Return the facts of the controller that executes an export format; None if unknown."""
    return next((x for x in all_facts() if name in x.formats), None)


def facts_of_player(name: str) -> ControllerFacts | None:
    """Return the facts of the controller with a name in `play --on`; None if unknown."""
    return next((x for x in all_facts() if x.player == name), None)


def read_facts(text: str, source: str) -> tuple[ControllerFacts, ...]:
    """Read the facts of controllers.

    Args:
        text: YAML text, like `controllers.yaml`.
        source: Its name for messages.

    Raises:
        InvalidInput: A fact has no source, or a value has no unit.
    """
    entries = yaml_loader.load(text, source)
    return tuple(_controller(name, entry) for name, entry in entries.items())


def _controller(name: str, entry: Mapping[str, Any]) -> ControllerFacts:
    """Return the facts of one controller."""
    fields = {key: value for key, value in entry.items() if key != "facts"}
    if others := sorted(fields.keys() - {"title", "formats", "player"}):
        raise InvalidInput(f"{others[0]} of {name} must be set by a fact, which states its source.")
    limits = dict[str, Any]()
    facts = []
    for item in entry["facts"]:
        words = dict(item)
        value = words.pop("value", None)
        unit = words.pop("unit", None)
        fact = Fact(**words)
        facts.append(fact)
        needed = UNITS.get(fact.sets)
        if unit != needed or (value is None) != (fact.sets == ""):
            raise InvalidInput(
                f"The value of {fact.sets or 'a fact'} of {name} must have the unit {needed}, but "
                f"is {show(value)} with the unit {show(unit)}."
            )
        if fact.sets in LIMIT_UNITS:
            limits[fact.sets] = value
        elif fact.sets:
            fields[fact.sets] = value
    return ControllerFacts(name=name, limits=Limits(**limits), facts=tuple(facts), **fields)
