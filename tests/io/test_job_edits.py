"""Keys of job files are set in their text; the rest stays as it was written."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour._yaml import load
from armcontour.errors import InvalidInput
from armcontour.io.job_edits import move_files, set_keys

TEXT = """\
# A cell.
name: cell   # its name
arm:
  # Before the work frame.
  name: ur5e
  work: {position: [0, 0, 0]}  # here
limits: {speed: 1 m/s}  # of the tool
path:
  frame:
    position: [1, 2, 3]   # where
    rpy: [0, 0, 0]
  # After it.
runs: {}
"""


def test_values_are_replaced_where_they_stand() -> None:
    found = set_keys(TEXT, {("arm", "work"): {"position": [1.5, 0, 0]}, ("name",): "new"})
    assert "  work: {position: [1.5, 0, 0]}  # here\n" in found
    assert "name: new   # its name\n" in found
    changed = [a for a, b in zip(TEXT.splitlines(), found.splitlines(), strict=True) if a != b]
    assert changed == ["name: cell   # its name", "  work: {position: [0, 0, 0]}  # here"]


def test_a_block_is_replaced_by_one_line_and_what_follows_stays() -> None:
    found = set_keys(TEXT, {("path", "frame"): {"position": [0, 0, 1]}})
    assert "  frame: {position: [0, 0, 1]}\n  # After it.\nruns: {}\n" in found


def test_new_keys_come_last_in_their_mapping() -> None:
    found = set_keys(TEXT, {("limits", "tool"): 2, ("arm", "tool"): 1, ("runs", "a", "b"): 3})
    assert "limits: {speed: 1 m/s, tool: 2}  # of the tool" in found
    assert "  work: {position: [0, 0, 0]}  # here\n  tool: 1\nlimits:" in found
    assert "runs: {a: {b: 3}}" in found


def test_what_is_no_mapping_becomes_one() -> None:
    assert set_keys("corners: sharp # so\na: 1\n", {("corners", "tolerance"): 1e-3}) == (
        "corners: {tolerance: 0.001} # so\na: 1\n"
    )
    assert set_keys("a:\nb: 1\n", {("a",): [1]}) == "a: [1]\nb: 1\n"


def test_what_is_shared_is_not_changed() -> None:
    text = "a: &x {k: 1}\nb: *x\n"
    with pytest.raises(InvalidInput, match=r"b\.k is shared with other keys.*write b\.k: 2"):
        set_keys(text, {("b", "k"): 2})


NAMES = st.text("abcd", min_size=1, max_size=3)
TREES = st.recursive(
    st.integers() | NAMES,
    lambda x: st.dictionaries(NAMES, x, max_size=3) | st.lists(x, max_size=2),
    max_leaves=8,
)


@given(st.dictionaries(NAMES, TREES, min_size=1), st.lists(NAMES, min_size=1, max_size=3), TREES)
def test_only_the_key_is_changed_in_any_text(data, keys, value) -> None:
    import yaml

    for style in (False, True):
        text = yaml.safe_dump(data, default_flow_style=style, sort_keys=False)
        at = wanted = json.loads(json.dumps(data))
        for key in keys[:-1]:
            if not isinstance(at.get(key), dict):
                at[key] = {}
            at = at[key]
        at[keys[-1]] = value
        try:
            assert load(set_keys(text, {tuple(keys): value}), "") == wanted
        except InvalidInput as error:
            # YAML writes equal parts once, by an alias.
            assert "shared" in str(error) and "*" in text


def test_files_are_named_from_another_folder(tmp_path: Path) -> None:
    (tmp_path / "jobs").mkdir()
    for name in ("arm.yaml", "part.dxf"):
        (tmp_path / name).write_text("")
    text = "arm: ../arm.yaml  # mine\npath: {file: '../part.dxf', names: [file]}\nother: part.dxf\n"
    assert move_files(text, tmp_path / "jobs", tmp_path / "out") == (
        "arm: ../arm.yaml  # mine\npath: {file: ../part.dxf, names: [file]}\nother: part.dxf\n"
    )
    found = move_files(text, tmp_path / "jobs", tmp_path)
    assert found.startswith("arm: arm.yaml  # mine\npath: {file: part.dxf,")
    gone = "path: {file: gone.dxf}\n"
    assert move_files(gone, tmp_path, tmp_path / "out") == gone
