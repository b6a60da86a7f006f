"""Tables of what is known about controllers that receive set-points, which `make docs` writes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np

from armcontour.core.fields import quantities
from armcontour.core.render import number
from armcontour.motion.controller_facts import ControllerFacts, Fact, all_facts
from armcontour.robot import Limits

PAGE = Path(__file__).parent / "controllers.md"
HEAD = """# Facts of controllers

This page lists what sources say about controllers that receive
[set-points](../glossary.md#servo-and-execution). armcontour reads the same
[data](../../src/armcontour/motion/controllers.yaml), and applies their limits and cycles in the
formats and players that a section names. **We have tried none of it on a robot.**
Controllers that plan the motion between the points of a program
([KRL and RAPID](../guides/controllers/kuka_abb.md#a-program)) are not listed.

- **Cycle**: time between the set-points that the controller reads. If it is empty, you set the
  cycle, or it is unknown.
- **Limits**: quantities whose limits are known. A multiple is that of the plan's limit, which is
  at most the arm's.
- **Beyond a limit**: the controller *stops*, *clamps* the command, or *filters* it.
- **Between set-points** that come less often than the controller reads them, it commands *lines* or
  *cubics*, *holds* the last one, or has a law of
  [`check --controller`](../guides/checking.md#commands-of-a-controller).
- **Evidence**: *MEASURED* on a controller by the source, *READ* in the source, or *UNVERIFIED*
  because no known source states it.
"""
SUMMARY = """
| controller | cycle | limits | beyond a limit | between set-points |
|---|---|---|---|---|
"""
DETAILS = """
| value | statement | evidence | source |
|---|---|---|---|
"""
# Issue or pull request of a repository.
ISSUE = re.compile(r"https://github\.com/[\w.-]+/([\w.-]+)/(?:issues|pull)/(\d+)")
FACTORS = {"velocity_factor": "joint_velocity", "acceleration_factor": "joint_acceleration"}


def published() -> dict[Path, str]:
    """Return the text of the generated page."""
    every = all_facts()
    summary = "".join(_summary_row(x) for x in every)
    sections = "".join(_section(x) for x in every)
    return {PAGE: f"{HEAD}{SUMMARY}{summary}{sections}"}


def _summary_row(facts: ControllerFacts) -> str:
    """Return a controller's row of the first table."""
    cycle = "" if facts.cycle is None else number(facts.cycle, "s")
    anchor = re.sub(r"[^\w\- ]", "", facts.title.lower()).replace(" ", "-")
    title = f"[{facts.title}](#{anchor})"
    cells = (title, cycle, ", ".join(_limits(facts)), facts.effect, facts.law)
    return f"| {' | '.join(cells)} |\n"


def _limits(facts: ControllerFacts) -> Iterator[str]:
    """Yield the names of the known limits, and the multiples of the arm's limits."""
    for field in fields(Limits):
        if field.init and getattr(facts.limits, field.name) is not None:
            yield f"`{field.name}`"
    for factor, name in FACTORS.items():
        value = getattr(facts, factor)
        if value is not None:
            yield f"{value:g} times `{name}`"


def _section(facts: ControllerFacts) -> str:
    """Return the heading and the table of one controller."""
    rows = []
    for fact in facts.facts:
        sources = ", ".join(_link(x) for x in fact.source.split(", "))
        rows.append(f"| {_value(facts, fact)} | {fact.text} | {fact.evidence} | {sources} |\n")
    return f"\n## {facts.title}\n{DETAILS}{''.join(rows)}"


def _value(facts: ControllerFacts, fact: Fact) -> str:
    """Return the value that a fact sets, with its name and its unit; empty for words only."""
    if not fact.sets:
        return ""
    of = facts.limits if hasattr(facts.limits, fact.sets) else facts
    value = getattr(of, fact.sets)
    if isinstance(value, str):
        return f"{fact.sets}: {value}"
    values = np.unique(value) if np.ptp(value) == 0 else value
    listed = ", ".join(f"{x:.7g}" for x in np.atleast_1d(values))
    unit = quantities(type(of))[fact.sets].words
    return f"`{fact.sets}`: {listed} {unit}".rstrip()


def _link(source: str) -> str:
    """Return a short link to a source with an address; other sources as they are."""
    if not source.startswith("https://"):
        return source
    if issue := ISSUE.match(source):
        label = f"{issue[1]}#{issue[2]}"
    elif "github.com" in source:
        label = source.rpartition("/")[2]
    else:
        label = source.split("/")[2]
    return f"[{label}]({source})"


if __name__ == "__main__":
    for file, content in published().items():
        file.write_text(content, encoding="utf-8")
