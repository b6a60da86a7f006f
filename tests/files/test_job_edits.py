"""Editing keys in the text of job files; other text does not change."""

import copy
from difflib import SequenceMatcher, ndiff
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from tests.files.tables import change_text, refusals

import armcontour
from armcontour.core.yaml_loader import load
from armcontour.files.job_patch import write_patch
from armcontour.files.job_text_edits import (
    REMOVE,
    Change,
    change_data,
    move_files,
    value_at,
)

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
runs: {a: {}}
"""


def test_an_edited_key_stays_in_place_and_a_new_key_is_last():
    patched = write_patch(TEXT, {("arm", "work"): {"position": [1.5, 0, 0]}, ("name",): "new"})
    changed = [b for a, b in zip(TEXT.splitlines(), patched.splitlines(), strict=True) if a != b]
    assert changed == ["name: new   # its name", "  work: {position: [1.5, 0, 0]}  # here"]
    # Keys that stay keep their lines, and what follows stays.
    patched = write_patch(TEXT, {("path", "frame"): {"position": [0, 0, 1]}})
    assert "  frame:\n    position: [0, 0, 1]   # where\n  # After it.\nruns: {a: {}}" in patched
    patched = write_patch(TEXT, {("path", "frame"): {"x": 1}})
    assert "path:\n  frame: {x: 1}\n  # After it.\nruns: {a: {}}\n" in patched
    patched = write_patch(TEXT, {("limits", "tool"): 2, ("arm", "tool"): 1, ("runs", "a", "b"): 3})
    assert "limits: {speed: 1 m/s, tool: 2}  # of the tool" in patched
    assert "  work: {position: [0, 0, 0]}  # here\n  tool: 1\nlimits:" in patched
    assert "runs: {a: {b: 3}}" in patched
    # What is no mapping becomes one.
    patched = write_patch("corners: sharp # so\na: 1\n", {("corners", "tolerance"): 1e-3})
    assert patched == "corners: {tolerance: 0.001} # so\na: 1\n"
    assert write_patch("a:\nb: 1\n", {("a",): [1]}) == "a: [1]\nb: 1\n"


def test_file_names_are_adapted_to_another_folder(tmp_path):
    (tmp_path / "jobs").mkdir()
    for name in ("arm.yaml", "part.dxf"):
        (tmp_path / name).write_text("")
    text = "arm: ../arm.yaml  # mine\npath: {file: '../part.dxf', names: [file]}\nother: part.dxf\n"
    assert move_files(text, tmp_path / "jobs", tmp_path / "out") == (
        "arm: ../arm.yaml  # mine\npath: {file: '../part.dxf', names: [file]}\nother: part.dxf\n"
    )
    moved = move_files(text, tmp_path / "jobs", tmp_path)
    assert moved.startswith("arm: arm.yaml  # mine\npath: {file: part.dxf,")
    gone = "path: {file: gone.dxf}\n"
    assert move_files(gone, tmp_path, tmp_path / "out") == gone
    # All files that are there are moved.
    text = "arm: {file: a.urdf, srdf: a.srdf}\npath: {file: p.dxf}\nscene: {files: [s.urdf]}\n"
    for name in ("a.srdf", "s.urdf"):
        (tmp_path / name).touch()
    moved = move_files(text, tmp_path, tmp_path / "in")
    assert "srdf: ../a.srdf" in moved and "files: [../s.urdf]" in moved and "file: p.dxf" in moved


# Values as users write them, and the data.
SCALARS = st.sampled_from([
    ("5 mm", "5 mm"), ("0.350", 0.35), ("'it''s'", "it's"), ('"a # b: \\u00e9"', "a # b: é"),
    ("größe µm", "größe µm"), ("-3", -3), ("true", True), ("null", None), ("1.0e-05", 1e-5),
    ("'007'", "007"),
])  # fmt: skip
KEYS = st.sampled_from(["a", "b", "größe", "x-1", "'on'", "7"])
NEW = st.recursive(
    st.sampled_from(
        [1, 0.25, "2 mm", "1e3", "no", "a: b # c", "é: ü'", None, False, "", "- x", "7"]
    ),
    lambda x: (
        st.dictionaries(st.sampled_from(["p", "q", 3]), x, max_size=2) | st.lists(x, max_size=3)
    ),
    max_leaves=5,
)


def key_of(written):
    return int(written) if written == "7" else written.strip("'")


@st.composite
def flows(draw, depth=2):
    """A value on one line, and what it is."""
    kind = draw(st.sampled_from("sslm")) if depth else "s"
    if kind == "s":
        return draw(SCALARS)
    gap = draw(st.sampled_from(["", " "]))
    inner = draw(st.lists(flows(depth - 1), max_size=3))
    if kind == "l":
        return f"[{gap}{', '.join(x for x, _ in inner)}{gap}]", [x for _, x in inner]
    names = draw(st.lists(KEYS, min_size=len(inner), max_size=len(inner), unique=True))
    text = ", ".join(f"{name}: {x}" for name, (x, _) in zip(names, inner, strict=True))
    pairs = zip(names, inner, strict=True)
    return f"{{{gap}{text}{gap}}}", {key_of(name): x for name, (_, x) in pairs}


@st.composite
def blocks(draw, indent="", depth=3):
    """Lines of a block with comments, and what they are."""
    names = draw(st.lists(KEYS, min_size=1, max_size=3, unique=True))
    listed = bool(indent) and draw(st.booleans())
    lines = []
    items = []
    data = {}
    for name in names:
        if draw(st.integers(0, 4)) == 0:
            lines.append(indent + f"# about - {name}: é")
        head = f"{indent}-" if listed else f"{indent}{name}:"
        if depth and draw(st.integers(0, 2)) == 0:
            below, value = draw(blocks(indent + draw(st.sampled_from(["  ", "    "])), depth - 1))
            lines += [head + draw(st.sampled_from(["", "  # below"])), *below]
        elif draw(st.integers(0, 9)) == 0:
            value = "two words"
            lines += [f"{head} |-", f"{indent}    two words"]
        else:
            text, value = draw(flows())
            lines.append(f"{head} {text}" + draw(st.sampled_from(["", " # so", "   # [x]: é"])))
        items.append(value)
        data[key_of(name)] = value
    return lines, items if listed else data


@st.composite
def documents(draw):
    lines, data = draw(blocks())
    eol = draw(st.sampled_from(["\n", "\n", "\r\n"]))
    head = draw(st.sampled_from([[], ["# first"], ["---"]]))
    return eol.join([*head, *lines]) + draw(st.sampled_from([eol, ""])), data


def places(data, keys=()):
    """All places in data, and some where nothing is."""
    keys_found = [keys] if keys else []
    if isinstance(data, dict):
        keys_found.append((*keys, "new"))
        for key, x in data.items():
            keys_found += places(x, (*keys, key))
    elif isinstance(data, list):
        for k, x in enumerate(data):
            keys_found += places(x, (*keys, k))
    return keys_found


def lists(data, keys=()):
    """All places at which an item can be inserted."""
    inner = data.items() if isinstance(data, dict) else ()
    paths = []
    if isinstance(data, list):
        inner = list(enumerate(data))
        paths = [(*keys, k) for k in range(len(data) + 1)]
    return paths + [y for key, x in inner for y in lists(x, (*keys, key))]


def changed(data, keys, value, how):
    """The data with a change, by plain mutation of a copy."""
    data = copy.deepcopy(data)
    container = data
    for key in keys[:-1]:
        container = container[key]
    if how == "insert":
        container.insert(keys[-1], value)
    elif how == "set":
        container[keys[-1]] = value
    elif not (isinstance(container, dict) and keys[-1] not in container):
        del container[keys[-1]]
    return data


@given(documents(), st.data())
def test_editing_any_yaml_text_changes_its_data_as_requested(document, draw):
    text, data = document
    assert load(text, "") == data
    how = draw.draw(st.sampled_from(["set", "remove", "insert"]))
    candidates = lists(data) if how == "insert" else places(data)
    if not candidates:
        return
    keys = draw.draw(st.sampled_from(candidates))
    value = REMOVE if how == "remove" else draw.draw(NEW)
    change = Change(keys, value, insert=how == "insert")
    expected = changed(data, keys, value, how)
    assert change_data(data, [change]) == expected
    edited = change_text(text, [change])
    assert load(edited, "") == expected
    if "\r" in text:
        assert "\n" not in edited.replace("\r\n", "")
    # All lines of other keys are the same.
    for key in set(data) - {keys[0]}:
        assert lines_of(edited, key) == lines_of(text, key)


def lines_of(text, key):
    """The lines of a key of the document, with their line breaks."""
    stripped = []
    inside = False
    for line in text.splitlines(keepends=True):
        if line[:1] not in " #-\r\n":
            name = line.partition(":")[0]
            inside = key_of(name) == key
        if inside and not line.startswith("#"):
            stripped.append(line.rstrip("\r\n"))
    return stripped


# A list with a line and a comment per item, and other layouts of hands.
LAYOUTS = """\
path:
    points: [
        [0 mm, 0 mm],     # start
        [10 mm, 0 mm],
        # the corner
        [10 mm, 20 mm],   # end
    ]
segments:
- to: [1, 2]     # first
  via: [0, 1]
# between
-   {to: [3, 4],
     speed: 0.350}   # second
base: &base
    speed: '1 m/s'
runs: {a: *base, b: {<<: *base}}
"""


def test_edits_keep_layouts_and_comments():
    def lines(*changes):
        """Removed and added lines of changes."""
        new = change_text(LAYOUTS, [Change(*x) for x in changes])
        compared = ndiff(LAYOUTS.splitlines(), new.splitlines())
        return [x for x in compared if x[0] in "+-"]

    point = ["5 mm", "5 mm"]
    assert lines((("path", "points", 1), point, True)) == ["+         [5 mm, 5 mm],"]
    assert lines((("path", "points", 0), point, True)) == ["+         [5 mm, 5 mm],"]
    assert lines((("path", "points", 3), point, True)) == [
        "-         [10 mm, 20 mm],   # end",
        "+         [10 mm, 20 mm], [5 mm, 5 mm],   # end",
    ]
    assert lines((("path", "points", 1),)) == ["-         [10 mm, 0 mm],"]
    assert lines((("path", "points", 2),)) == ["-         [10 mm, 20 mm],   # end"]
    assert lines((("path", "points", 0, 1), 0.5)) == [
        "-         [0 mm, 0 mm],     # start",
        "+         [0 mm, 0.5],     # start",
    ]
    assert lines((("segments", 0, "to"),)) == [
        "- - to: [1, 2]     # first",
        "-   via: [0, 1]",
        "+ - via: [0, 1]",
    ]
    assert lines((("segments", 1, "to"),)) == [
        "- -   {to: [3, 4],",
        "-      speed: 0.350}   # second",
        "+ -   {speed: 0.350}   # second",
    ]
    assert lines((("segments", 1), {"to": [5, 6]}, True)) == ["+ - {to: [5, 6]}"]
    assert lines((("runs", "a", "kp"), 5)) == [
        "- runs: {a: *base, b: {<<: *base}}",
        "+ runs: {a: {speed: 1 m/s, kp: 5}, b: {<<: *base}}",
    ]


def test_an_edit_of_a_job_changes_only_one_place_in_its_text():
    """Keys of the jobs and cells of the package are set, added and removed."""
    folder = Path(armcontour.__file__).parent
    edits = 0
    for file in [*folder.glob("jobs/library/*.yaml"), *folder.glob("files/cells/*.yaml")]:
        text = file.read_text("utf-8")
        data = load(text, file.name)
        for keys in places(data):
            for value in ("7 mm", REMOVE):
                new = change_text(text, [Change(keys, value)])
                lines = SequenceMatcher(None, text.splitlines(), new.splitlines(), autojunk=False)
                changes = [x for x in lines.get_opcodes() if x[0] != "equal"]
                # Comments between a key and the mapping below the key stay.
                outer = keys[:-1] if value is REMOVE and value_at(data, keys) is not None else keys
                between = isinstance(value_at(data, outer), dict)
                assert len(changes) <= 1 + between, (file, keys)
                edits += 1
    assert edits > 500


def test_aliases_are_replaced_by_their_values_or_refused():
    text = "a: &x [1, 2]\nb: *x   # so\nc: {<<: &y {k: 1}, l: 2}\n"
    assert change_text(text, [Change(("b", 0), 5)]) == text.replace("*x", "[5, 2]")
    changed = text.replace("[1, 2]", "[1, 3]").replace("*x", "[1, 2]")
    assert change_text(text, [Change(("a", 1), 3)]) == changed
    # A merged key can be overridden, but not removed.
    assert "c: {<<: &y {k: 1}, l: 2, k: 3}" in change_text(text, [Change(("c", "k"), 3)])
    shared = [(x, "other keys share a value ... by hand") for x in (("a",), ("c", "k"))]
    refusals(lambda x: change_text(text, [Change(x)]), shared)
    # The new key would be merged too.
    refusals(lambda x: change_text(LAYOUTS, [Change(x, 1)]), [(("base", "kp"), "by hand")])
    absent = [(("a", 3), "a (item 4) ... only 2 items"), (("a", "b"), "only 2 items")]
    refusals(lambda x: change_data({"a": [1, 2]}, [Change(x, 1, insert=True)]), absent)
