"""The built-in arms as lines of text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

# Width of the text [characters].
WIDTH = 100


def list_arms() -> Iterator[str]:
    """Lines with the name of every built-in arm, the source of its numbers and what is assumed."""
    from armcontour.files.robots.loading import arm_names, load_arm

    for name in arm_names():
        arm = load_arm(name)
        chain = arm.chain
        heavy = chain is not None and chain.masses is not None
        yield f"{name}: {arm.name}, {arm.dof} joints, masses {'known' if heavy else 'not known'}"
        yield from _indent(f"source: {arm.source}")
        if chain is not None and chain.assumed:
            yield from _indent(f"assumed: {chain.assumed}")


def _indent(text: str) -> list[str]:
    """Wrap a text into indented lines."""
    return textwrap.wrap(text, WIDTH, initial_indent="    ", subsequent_indent="        ")
