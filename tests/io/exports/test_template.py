"""Templates: ours read back by the test's own parsers; the user's, and what is wrong with them."""

import dataclasses
import os
import re
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.io.tables import refusals

from armcontour.io.exports import templates, write_table

NUMBER = r"-?\d+\.\d+"
AXES = ", ".join(rf"A{k} ({NUMBER})" for k in range(1, 7))
SPTP = re.compile(rf"(SPTP|PTP) \{{{AXES}\}}")
TRIGGER = rf"TRIGGER WHEN PATH = 0 ONSTART DELAY = ({NUMBER}) DO \$OUT\[(\d+)\] = (TRUE|FALSE)"
MOVE = re.compile(
    rf"MoveAbsJ \[\[([^\]]*)\], \[9E9(?:, 9E9){{5}}\]\], (v50|v1000 \\T:=({NUMBER})), (\w+), tool0;"
)
# What the events of the tables are called in comments.
SAID = ["tool=on", "gas=2.5", 'label="A, \\"b\\"; 7"', "tool=off", "tool=on"]


def made(table, tmp_path, template, *, stem="made", **options):
    file = tmp_path / f"{stem}.txt"
    write_table(table, file, format="template", template=template, **options)
    return file.read_text(encoding="utf-8")


def house(tmp_path, text):
    file = tmp_path / "house.j2"
    file.write_text(text, encoding="utf-8")
    return file


def check_events(text, table):
    """All events are in comments, in order."""
    found = [(x, float(t)) for x, t in re.findall(rf"[;!] (.*) at ({NUMBER}) s", text)]
    assert found == [(x, round(y.t, 6)) for x, y in zip(SAID, table.events, strict=True)]


def counted(lines, start, found):
    """How many lines begin so before each line that is found, and those lines."""
    at = [i for i, x in enumerate(lines) if found(x)]
    return [(sum(x.startswith(start) for x in lines[:i]), lines[i]) for i in at]


def test_kuka_has_every_point_its_time_and_the_events_in_order(table, tmp_path):
    given = table(6, count=9)
    text = made(given, tmp_path, "kuka", outputs={"tool": 17})
    lines = [x.strip() for x in text.splitlines()]
    assert lines[2] == "DEF made( )" and lines[-1] == "END" and "{{" not in text
    points = [(m[1], [float(x) for x in m.groups()[1:]]) for x in lines if (m := SPTP.match(x))]
    assert [kind for kind, _ in points] == ["PTP"] + ["SPTP"] * 8
    np.testing.assert_allclose([q for _, q in points], np.degrees(given.q), rtol=0, atol=6e-7)
    parts = [float(x) for x in re.findall(rf"TIME_BLOCK PART = ({NUMBER})", text)]
    whole = float(re.findall(rf"TIME_BLOCK END = ({NUMBER})", text)[0])
    times = np.cumsum([0, *parts]) / 100 * whole
    np.testing.assert_allclose([*times, whole], given.t, rtol=0, atol=1e-6)
    check_events(text, given)
    # Triggers stand before the segment in which they count, with the time since its start.
    assert re.findall(TRIGGER, text) == [("0.000", "17", "TRUE"), ("0.000", "17", "FALSE")]
    before = counted(lines, "SPTP", lambda x: re.match(TRIGGER, x))
    assert [n for n, _ in before] == [0, 3]
    assert lines[-4:-1] == ["WAIT SEC 0.013500", "; tool=on at 0.045500 s", "$OUT[17] = TRUE"]


def test_abb_has_every_point_its_time_and_the_events_in_order(table, tmp_path):
    given = table(6, count=9)
    text = made(given, tmp_path, "abb", outputs={"tool": "doTool"})
    lines = [x.strip() for x in text.splitlines()]
    assert lines[0] == "MODULE part_7" and lines[-1] == "ENDMODULE"
    moves = [m for x in lines if (m := MOVE.fullmatch(x))]
    q = [[float(x) for x in m[1].split(",")] for m in moves]
    np.testing.assert_allclose(q, np.degrees(given.q), rtol=0, atol=6e-7)
    times = np.cumsum([0, *(float(m[3]) for m in moves[1:])])
    np.testing.assert_allclose(times, given.t, rtol=0, atol=5e-6)
    assert [m[4] for m in moves] == ["fine", *["z1"] * 7, "fine"]
    check_events(text, given)
    assert re.findall(r"SetDO (\w+), (\d);", text) == [("doTool", x) for x in "101"]
    assert lines[-5:-3] == ["WaitTime 0.013500;", "! tool=on at 0.045500 s"]


def test_analog_outputs_are_set_where_they_change(table, tmp_path):
    power = np.array([0.0, 0.2, 0.2, 0.6, 1.0, 1.0, 0.3, 0.3, 0.1])
    given = dataclasses.replace(table(6, count=9, events=()), analog={"power": power, "gas": power})
    changes = [0, 1, 3, 4, 6, 8]
    text = made(given, tmp_path, "kuka", outputs={"power": 2})
    found = counted(text.splitlines(), "SPTP ", lambda x: "$ANOUT[2] =" in x)
    assert [(n, float(x.split("= ")[-1])) for n, x in found] == [(k, power[k]) for k in changes]
    assert "TRIGGER WHEN PATH = 0 ONSTART DELAY = 0.000 DO $ANOUT[2] = 0.600000\n" in text
    lines = [x.strip() for x in made(given, tmp_path, "abb", outputs={"power": "aoP"}).splitlines()]
    found = counted(lines, "MoveAbsJ", lambda x: x.startswith("SetAO aoP, "))
    values = [(n - 1, float(x[len("SetAO aoP, ") : -1])) for n, x in found]
    assert values == [(k, power[k]) for k in changes]
    high = dataclasses.replace(given, analog={"power": 10 * power})
    outputs = [({"power": 2}, "power ... from -1 to 1")]
    refusals(lambda x: made(high, tmp_path, "kuka", outputs=x), outputs)
    assert "SetAO aoP, 10.000000;" in made(high, tmp_path, "abb", outputs={"power": "aoP"})


def test_ours_refuse_arms_of_other_joints_and_other_outputs(table, tmp_path):
    names = "controller are signals by their names"
    numbers = "controller are whole numbers from 1"
    table_of = {
        "kuka": (1, numbers, [1.5, True, 0, -1, "1] = TRUE", None]),
        "abb": ("doGas", names, [1]),
    }
    assert set(templates()) == set(table_of)
    for name, (good, words, bad) in table_of.items():
        refusals(lambda x, n=name: made(table(x), tmp_path, n), [(2, f"{name}. ... 6 ... has 2")])
        outputs = [({"gas": good}, "the event gas"), *(({"tool": x}, words) for x in bad)]
        refusals(lambda x, n=name: made(table(6), tmp_path, n, outputs=x), outputs)
    assert "$OUT[3] =" in made(table(6), tmp_path, "kuka", outputs={"tool": np.int64(3)})
    taken = ("do Tool", "do;\nStop", "7th", "_do", "", "EndIf", 33 * "d")
    outputs = [({"tool": x}, "RAPID takes no signal of the name") for x in taken]
    refusals(lambda x: made(table(6), tmp_path, "abb", outputs=x), outputs)


def test_a_kuka_program_is_called_like_its_file(table, tmp_path):
    text = made(table(6), tmp_path, "kuka", stem="a_7" + 21 * "b")
    assert f"\nDEF a_7{21 * 'b'}( )\n" in text and "\n; part 7: " in text

    stems = ("7 Löcher", "7_holes", "a-b", 25 * "a", "def", "EndSpline", "i")
    bad = [(x, f"KRL takes no program {x}") for x in stems]
    refusals(lambda x: made(table(6), tmp_path, "kuka", stem=x), bad)


def test_an_abb_module_has_a_name_that_rapid_takes(table, tmp_path):
    for name, module in (
        ("7 holes", "m_7_holes"),
        ("ö", "m_"),
        ("_part", "m_part"),
        ("Test", "m_Test"),
        ("armcontour", "m_armcontour"),
        ("testing", "testing"),
        ("a" * 33, "a" * 32),
    ):
        text = made(dataclasses.replace(table(6), name=name), tmp_path, "abb")
        about = f"  ! {name}: 9 points in 0.032000 s, axes in degrees"
        assert text.splitlines()[:2] == [f"MODULE {module}", about]


def test_the_template_of_the_guide_does_what_it_says(table, tmp_path):
    guide = FilePath(__file__).parents[3] / "docs" / "guides" / "export.md"
    template = guide.read_text(encoding="utf-8").split("```jinja\n")[1].split("```")[0]
    given = table(6, count=9)
    text = made(given, tmp_path, house(tmp_path, template), outputs={"tool": 4})
    moves = [x.split()[1:] for x in text.splitlines() if x.startswith("MOVE")]
    degrees = [[float(x) for x in " ".join(x[1:]).split(",")] for x in moves]
    np.testing.assert_allclose(np.radians(degrees), given.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose([float(x[0]) for x in moves], given.t * 1e3, rtol=0, atol=1e-9)
    assert re.findall("^OUT.*", text, re.M) == [f"OUT 4 {x}" for x in ("ON", "OFF", "ON")]


ALL = """\
{{ name }}|{{ file }}|{{ name|identifier }}|{{ joint_names|join('/') }}|{{ dof }}|{{ period }}|\
{{ duration }}|{{ start_time }}|{{ events|length }}|{{ outputs.tool }}
{% for p in points %}
{{ p.number }} {{ p.t }} {{ p.q|degrees|fixed(9) }} {{ p.q_deg|fixed(9) }} {{ p.dq|fixed(3) }} \
{{ p.ddq|fixed(3) }} {{ p.tool|times(1000)|fixed(1) }}\
{% for e in p.events %} {{ e.name }}:{{ e.value }}:{{ e.t|fixed(6) }}{% endfor %}

{% endfor %}
"""


def test_a_house_template_sees_all_of_the_table(table, tmp_path):
    tool = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
    given = dataclasses.replace(table(2, count=3), tool=tool, start_time=-0.008)
    text = made(given, tmp_path, house(tmp_path, ALL), outputs={"tool": 4})
    first, *rows = (x for x in text.splitlines() if x)
    assert first == "part 7|made|part_7|axis_1/axis_2|2|0.004|0.008|-0.008|5|4"
    assert [x.split()[0] for x in rows] == ["1", "2", "3"]
    degrees = ", ".join(f"{x:.9f}" for x in np.degrees(given.q[1]))
    assert rows[1].startswith(f"2 0.004 {degrees} {degrees} ")
    assert "300.0, 400.0" in rows[1] and "gas:2.5:0.005123" in rows[1]


WRONG = [
    ("line one\n{% for %}\n", "house.j2, line 2:"),
    ("one\ntwo\n{{ points[0].speed }}\n", "house.j2, line 3: ... speed"),
    ("one\n\n{{ nothing }}", "house.j2, line 3: ... 'nothing' is undefined"),
    ("{{ 1 / 0 }}", "house.j2, line 1: ... division by zero"),
    ("{{ points[0].tool|fixed }}", "house.j2, line 1:"),
    ("one\n{{ ''.__class__.__mro__ }}", "house.j2, line 2: ... unsafe"),
    ("{{ events.append(1) }}", "house.j2, line 1:"),
    ("{{ outputs.update({'a': 1}) }}", "house.j2, line 1: ... unsafe"),
    ("one\n{% include 'other.j2' %}", "house.j2, line 2: ... no template 'other.j2'"),
    ("{% include '../secret' %}", "house.j2, line 1:"),
    ("{{ 1|nofilter }}", "house.j2, line 1: ... nofilter"),
    ("{{ refuse('only on Sundays') }}", "house.j2: only on Sundays"),
    ("one\n{% include 'part.j2' %}", "part.j2, line 2:"),
]


def test_what_is_wrong_with_a_template_is_one_sentence_with_its_line(table, tmp_path):
    (tmp_path / "part.j2").write_text("one\n{% if %}\n")
    refusals(lambda x: made(table(), tmp_path, house(tmp_path, x)), WRONG)


def test_refuses_templates_that_are_not_there(table, tmp_path):
    (tmp_path / "folder.j2").mkdir()
    os.mkfifo(tmp_path / "pipe.j2")
    (tmp_path / "latin.j2").write_bytes(b"\xe9")
    places = [
        ("fanuc", "'fanuc' ... kuka ... abb"),
        (tmp_path / "no.j2", "There is no template"),
        (tmp_path / "folder.j2", "Is a directory"),
        (tmp_path / "pipe.j2", "not a regular file"),
        ("a\0b", "There is no template"),
        ("a" * 5000, "There is no template"),
        (tmp_path / "latin.j2", "not UTF-8"),
    ]
    refusals(lambda x: made(table(), tmp_path, x), places)


@pytest.mark.parametrize("how", ["include", "import", "extends"])
def test_a_template_takes_others_only_from_its_folder(table, tmp_path, how):
    folder, outside = tmp_path / "house", tmp_path / "secret.txt"
    (folder / "parts").mkdir(parents=True)
    outside.write_text("SECRET")
    (folder / "out.j2").symlink_to(outside)
    (folder / "up").symlink_to(tmp_path)
    (folder / "gone.j2").symlink_to(folder / "nothing.j2")
    os.mkfifo(folder / "pipe.j2")
    (folder / "parts" / "head.j2").write_text("HEAD")
    (folder / "inside.j2").symlink_to(folder / "parts" / "head.j2")
    end = " as x" if how == "import" else ""

    def of(name):
        file = folder / "main.j2"
        file.write_text(f"{{% {how} '{name}'{end} %}}")
        return file

    bad = [
        ("out.j2", "leads out of the folder"),
        ("up/secret.txt", "leads out of the folder"),
        ("gone.j2", "There is no template"),
        ("pipe.j2", "not a regular file"),
        ("../secret.txt", "no template '../secret.txt'"),
        (str(outside), "no template"),
    ]
    refusals(lambda x: made(table(), tmp_path, of(x)), bad, "main.j2")
    for name in ("inside.j2", "parts/head.j2"):
        text = made(table(), tmp_path, of(name))
        assert text == ("" if how == "import" else "HEAD")
