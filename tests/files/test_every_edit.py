"""Errors of wrong edits of job files state the edited key and its line."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import pytest
import yaml

import armcontour as ac
from armcontour.files.job_file import parse_job
from armcontour.files.job_text_edits import line_of

FULL = Path(__file__).with_name("full_job.yaml").read_text(encoding="utf-8")
LIBRARY = resources.files("armcontour.jobs") / "library"
TEXTS = (FULL, *((LIBRARY / name).read_text("utf-8") for name in ("plate.yaml", "paper.yaml")))


def entries(node: yaml.Node, keys: tuple[str | int, ...] = ()) -> Iterator[tuple]:
    """Key paths, keys and values of a document, by PyYAML's nodes."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield (*keys, key.value), key, value
            yield from entries(value, (*keys, key.value))
    elif isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            if isinstance(item, yaml.MappingNode):
                yield from entries(item, (*keys, i))


def wrong_edits(text: str) -> Iterator[tuple[str, tuple[str | int, ...], int]]:
    """Texts with one edit, the key path of the edit, and the number of its line."""
    for keys, key, value in entries(yaml.compose(text)):
        begin, end = value.start_mark.index, value.end_mark.index
        line = key.start_mark.line + 1
        if isinstance(value, yaml.ScalarNode):
            for wrong in ("banana", "[1, banana]", "{zzz: 1}", "-1e15", "''"):
                yield text[:begin] + wrong + text[end:], keys, line
            new = (*keys[:-1], f"{keys[-1]}x")
            yield text[: key.end_mark.index] + "x" + text[key.end_mark.index :], new, line
        elif value.start_mark.line == value.end_mark.line:
            yield text[:begin] + "banana" + text[end:], keys, line
        if isinstance(value, yaml.MappingNode) and value.value:
            mark = value.value[0][0].start_mark
            added = "zzz: 1" + (", " if value.flow_style else f"\n{' ' * mark.column}")
            yield text[: mark.index] + added + text[mark.index :], (*keys, "zzz"), mark.line + 1


@pytest.mark.parametrize("text", TEXTS, ids=["full", "plate", "paper"])
def test_wrong_edits_are_refused_with_their_key_and_line(text, monkeypatch):
    monkeypatch.chdir(str(LIBRARY))
    parse_job(text)
    refused = 0
    for changed, keys, line in wrong_edits(text):
        try:
            parse_job(changed)
        except ac.ArmContourError as error:
            refused += 1
            assert error.key[: len(keys)] == keys, (keys, str(error))
            assert line_of(changed, error.key) == line, (keys, str(error))
    assert refused > 100
