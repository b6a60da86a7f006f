"""Edits of the rules that select edges of a CAD model: an edge is picked or removed."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.files.job_text_edits import Change
from armcontour.files.model.edge_picking import EdgePicker, written_rule
from armcontour.studio.handles import EditState

# Largest number of edges that rules for single edges replace when one of them is removed.
MOST_SINGLE = 20
EDGES = ("path", "edges")


def pick(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that add the rule of an edge, or with `like` of all edges like it.

    Rules all of whose edges the new rule names are removed.
    """
    picker = _picker(state)
    index = _edge(edit, picker)
    written = _written(state)
    rules = state.rules or ()
    selected = picker.select(rules) if rules else {}
    if edit.get("like") is True:
        rule = picker.rule_like(index)
        named = set(picker.select([rule]))
    else:
        rule = picker.rule_at(index)
        named = {index}
        if index in selected:
            raise InvalidInput("The edge is already selected.")
    stays = [
        k for k in range(len(written)) if not {i for i, n in selected.items() if n == k} <= named
    ]
    return [Change(EDGES, [*(written[k] for k in stays), written_rule(rule)])]


def unpick(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that remove an edge, or with `like` all edges of its rule."""
    picker = _picker(state)
    index = _edge(edit, picker)
    written = _written(state)
    if state.rules is None:
        raise InvalidInput("The edge is not selected.")
    selected = picker.select(state.rules)
    if index not in selected:
        raise InvalidInput("The edge is not selected.")
    number = selected[index]
    others = [i for i, n in selected.items() if n == number and i != index]
    single: list[dict[str, Any]] = []
    if edit.get("like") is not True:
        if len(others) > MOST_SINGLE:
            raise InvalidInput(
                f"The rule of this edge selects {len(others) + 1} edges. A single one can be "
                f"removed from at most {MOST_SINGLE + 1}. Remove all of them, and add the edges "
                "that you need."
            )
        layer = state.rules[number].layer if state.rules else ""
        single = [written_rule(picker.rule_at(i, layer)) for i in others]
    return [Change(EDGES, [*written[:number], *single, *written[number + 1 :]])]


def _picker(state: EditState) -> EdgePicker:
    """Return the edges of the document's model."""
    if state.picker is None:
        raise InvalidInput("Edges can be selected when the CAD model of the path has been read.")
    return state.picker


def _edge(edit: Mapping[str, Any], picker: EdgePicker) -> int:
    """Return the index of an edit's edge."""
    return picker.edges[checks.check_int("edge", edit["edge"], 0, len(picker.edges) - 1)]


def _written(state: EditState) -> list[Any]:
    """Return the rules as they are written in the job."""
    written = state.data["path"].get("edges")
    if written is None:
        return []
    return deepcopy(written if isinstance(written, list) else [written])
