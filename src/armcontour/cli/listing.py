"""The built-in arms as lines of text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

# Columns of text.
WIDTH = 100


def listed_arms() -> Iterator[str]:
    """A line for every arm, and below it where its numbers come from and what is assumed."""
    from armcontour.io.robots.loading import arm_names, load_arm

    for name in arm_names():
        arm = load_arm(name)
        chain = arm.chain
        heavy = chain is not None and chain.masses is not None
        yield f"{name}: {arm.name}, {arm.dof} joints, masses {'known' if heavy else 'not known'}"
        yield from _indented(f"source: {arm.source}")
        if chain is not None and chain.assumed:
            yield from _indented(f"assumed: {chain.assumed}")


def _indented(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="        ")
