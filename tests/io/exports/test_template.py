"""Templates: ours read back by the test's own parsers; the user's, and what is wrong with them."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.io.exports import Table, templates, write_table

NUMBER = r"-?\d+\.\d+"
SPTP = re.compile(
    rf"(SPTP|PTP) \{{A1 ({NUMBER}), A2 ({NUMBER}), A3 ({NUMBER}), A4 ({NUMBER}), "
    rf"A5 ({NUMBER}), A6 ({NUMBER})\}}"
)
TRIGGER = re.compile(
    rf"TRIGGER WHEN PATH = 0 ONSTART DELAY = ({NUMBER}) DO \$OUT\[(\d+)\] = (TRUE|FALSE)"
)
MOVE = re.compile(
    rf"MoveAbsJ \[\[([^\]]*)\], \[9E9(?:, 9E9){{5}}\]\], (v50|v1000 \\T:=({NUMBER})), (\w+), tool0;"
)
SAID = re.compile(rf"[;!] (.*) at ({NUMBER}) s")


def made(
    table: Table, tmp_path: FilePath, template: Any, *, stem: str = "made", **options: Any
) -> str:
    file = tmp_path / f"{stem}.txt"
    write_table(table, file, format="template", template=template, **options)
    return file.read_text(encoding="utf-8")


def house(tmp_path: FilePath, text: str) -> FilePath:
    file = tmp_path / "house.j2"
    file.write_text(text, encoding="utf-8")
    return file


def told(text: str) -> list[tuple[str, float]]:
    return [(what, float(t)) for what, t in SAID.findall(text)]


def expected(table: Table) -> list[tuple[str, float]]:
    words = ["tool=on", "gas=2.5", 'label="A, \\"b\\"; 7"', "tool=off", "tool=on"]
    return [(word, round(x.t, 6)) for word, x in zip(words, table.events, strict=True)]


def test_kuka_has_every_point_its_time_and_the_events_in_order(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
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
    assert told(text) == expected(given)
    # Triggers stand before the segment in which they count, with the time since its start.
    assert TRIGGER.findall(text) == [("0.000", "17", "TRUE"), ("0.000", "17", "FALSE")]
    before = [
        sum(x.startswith("SPTP") for x in lines[:i])
        for i, x in enumerate(lines)
        if TRIGGER.match(x)
    ]
    assert before == [0, 3]
    assert lines[-4:-1] == ["WAIT SEC 0.013500", "; tool=on at 0.045500 s", "$OUT[17] = TRUE"]


def test_abb_has_every_point_its_time_and_the_events_in_order(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
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
    assert told(text) == expected(given)
    assert re.findall(r"SetDO (\w+), (\d);", text) == [("doTool", x) for x in "101"]
    assert lines[-5:-3] == ["WaitTime 0.013500;", "! tool=on at 0.045500 s"]


def test_analog_outputs_are_set_where_they_change(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    power = np.array([0.0, 0.2, 0.2, 0.6, 1.0, 1.0, 0.3, 0.3, 0.1])
    given = dataclasses.replace(table(6, count=9, events=()), analog={"power": power, "gas": power})
    changes = [0, 1, 3, 4, 6, 8]
    lines = made(given, tmp_path, "kuka", outputs={"power": 2}).splitlines()
    found = [
        (sum(x.startswith("SPTP ") for x in lines[:i]), float(x.split("= ")[-1]))
        for i, x in enumerate(lines)
        if "$ANOUT[2] =" in x
    ]
    assert found == [(k, power[k]) for k in changes]
    assert "TRIGGER WHEN PATH = 0 ONSTART DELAY = 0.000 DO $ANOUT[2] = 0.600000" in lines
    lines = [x.strip() for x in made(given, tmp_path, "abb", outputs={"power": "aoP"}).splitlines()]
    found = [
        (sum(x.startswith("MoveAbsJ") for x in lines[:i]) - 1, float(x[len("SetAO aoP, ") : -1]))
        for i, x in enumerate(lines)
        if x.startswith("SetAO aoP, ")
    ]
    assert found == [(k, power[k]) for k in changes]
    high = dataclasses.replace(given, analog={"power": 10 * power})
    refuses(
        lambda: made(high, tmp_path, "kuka", outputs={"power": 2}),
        InvalidInput,
        "power",
        "from -1 to 1",
    )
    assert "SetAO aoP, 10.000000;" in made(high, tmp_path, "abb", outputs={"power": "aoP"})


@pytest.mark.parametrize("name", templates())
def test_ours_refuse_arms_of_other_joints_and_values_on_digital_outputs(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None], name: str
) -> None:
    refuses(lambda: made(table(2), tmp_path, name), InvalidInput, f"{name}.", "6", "has 2")
    good, bad = (1, 0) if name == "kuka" else ("doGas", 1)
    refuses(
        lambda: made(table(6), tmp_path, name, outputs={"gas": good}), InvalidInput, "the event gas"
    )
    refuses(
        lambda: made(table(6), tmp_path, name, outputs={"tool": bad}),
        InvalidInput,
        f"controller are {'whole numbers from 1' if name == 'kuka' else 'signals by their names'}",
    )


def test_an_abb_module_is_cut_if_its_name_is_too_long(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = dataclasses.replace(table(6), name="a" * 33)
    assert re.search(r"MODULE a{32}\b", made(given, tmp_path, "abb"))


def test_a_kuka_program_is_called_like_its_file(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    text = made(table(6), tmp_path, "kuka", stem="a_7" + 21 * "b")
    assert f"\nDEF a_7{21 * 'b'}( )\n" in text and "\n; part 7: " in text


@pytest.mark.parametrize("stem", ["7 Löcher", "7_holes", "a-b", 25 * "a", "def", "EndSpline", "i"])
def test_a_file_whose_name_krl_does_not_take_is_refused(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None], stem: str
) -> None:
    words = f"KRL takes no program {stem}"
    refuses(lambda: made(table(6), tmp_path, "kuka", stem=stem), InvalidInput, words)


@pytest.mark.parametrize("output", [1.5, True, 0, -1, "1] = TRUE", None])
def test_a_kuka_output_is_a_whole_number(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None], output: Any
) -> None:
    words = f"whole numbers from 1, not {output}"
    refuses(lambda: made(table(6), tmp_path, "kuka", outputs={"tool": output}), InvalidInput, words)
    assert "$OUT[3] =" in made(table(6), tmp_path, "kuka", outputs={"tool": np.int64(3)})


@pytest.mark.parametrize("output", ["do Tool", "do;\nStop", "7th", "_do", "", "EndIf", 33 * "d"])
def test_an_abb_output_is_a_name_that_rapid_takes(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None], output: str
) -> None:
    refuses(
        lambda: made(table(6), tmp_path, "abb", outputs={"tool": output}),
        InvalidInput,
        "RAPID takes no signal of the name",
    )


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("7 holes", "m_7_holes"),
        ("ö", "m_"),
        ("_part", "m_part"),
        ("Test", "m_Test"),
        ("armcontour", "m_armcontour"),
        ("testing", "testing"),
    ],
)
def test_an_abb_module_has_a_name_that_rapid_takes(
    table: Callable[..., Table], tmp_path: FilePath, name: str, module: str
) -> None:
    text = made(dataclasses.replace(table(6), name=name), tmp_path, "abb")
    assert text.splitlines()[:2] == [
        f"MODULE {module}",
        f"  ! {name}: 9 points in 0.032000 s, axes in degrees",
    ]


def test_the_template_of_the_guide_does_what_it_says(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    guide = FilePath(__file__).parents[3] / "docs" / "guides" / "export.md"
    template = guide.read_text(encoding="utf-8").split("```jinja\n")[1].split("```")[0]
    given = table(6, count=9)
    text = made(given, tmp_path, house(tmp_path, template), outputs={"tool": 4})
    moves = [x.split()[1:] for x in text.splitlines() if x.startswith("MOVE")]
    degrees = [[float(x) for x in " ".join(x[1:]).split(",")] for x in moves]
    np.testing.assert_allclose(np.radians(degrees), given.q, rtol=0, atol=1e-8)
    np.testing.assert_allclose([float(x[0]) for x in moves], given.t * 1e3, rtol=0, atol=1e-9)
    assert [x for x in text.splitlines() if x.startswith("OUT")] == [
        f"OUT 4 {x}" for x in ("ON", "OFF", "ON")
    ]


def test_a_house_template_sees_all_of_the_table(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = dataclasses.replace(
        table(2, count=3), tool=np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]), start_time=-0.008
    )
    text = made(
        given,
        tmp_path,
        house(
            tmp_path,
            "{{ name }}|{{ file }}|{{ name|identifier }}|{{ joint_names|join('/') }}|{{ dof }}|"
            "{{ period }}|{{ duration }}|{{ start_time }}|{{ events|length }}|{{ outputs.tool }}\n"
            "{% for p in points %}\n"
            "{{ p.number }} {{ p.t }} {{ p.q|degrees|fixed(9) }} {{ p.q_deg|fixed(9) }} "
            "{{ p.dq|fixed(3) }} {{ p.ddq|fixed(3) }} {{ p.tool|times(1000)|fixed(1) }}"
            "{% for e in p.events %} {{ e.name }}:{{ e.value }}:{{ e.t|fixed(6) }}{% endfor %}\n\n"
            "{% endfor %}\n",
        ),
        outputs={"tool": 4},
    )
    lines = text.splitlines()
    assert lines[0] == "part 7|made|part_7|axis_1/axis_2|2|0.004|0.008|-0.008|5|4"
    rows = [x for x in lines[1:] if x]
    assert [x.split()[0] for x in rows] == ["1", "2", "3"]
    degrees = ", ".join(f"{x:.9f}" for x in np.degrees(given.q[1]))
    assert rows[1].startswith(f"2 0.004 {degrees} {degrees} ")
    assert "300.0, 400.0" in rows[1] and "gas:2.5:0.005123" in rows[1]


WRONG = (
    ("line one\n{% for %}\n", "house.j2, line 2:"),
    ("one\ntwo\n{{ points[0].speed }}\n", "house.j2, line 3:", "speed"),
    ("one\n\n{{ nothing }}", "house.j2, line 3:", "'nothing' is undefined"),
    ("{{ 1 / 0 }}", "house.j2, line 1:", "division by zero"),
    ("{{ points[0].tool|fixed }}", "house.j2, line 1:"),
    ("one\n{{ ''.__class__.__mro__ }}", "house.j2, line 2:", "unsafe"),
    ("{{ events.append(1) }}", "house.j2, line 1:"),
    ("{{ outputs.update({'a': 1}) }}", "house.j2, line 1:", "unsafe"),
    ("one\n{% include 'other.j2' %}", "house.j2, line 2:", "no template 'other.j2'"),
    ("{% include '../secret' %}", "house.j2, line 1:"),
    ("{{ 1|nofilter }}", "house.j2, line 1:", "nofilter"),
    ("{{ refuse('only on Sundays') }}", "house.j2: only on Sundays"),
    ("one\n{% include 'part.j2' %}", "part.j2, line 2:"),
)


@pytest.mark.parametrize("case", WRONG, ids=[x[0].replace("\n", " ") for x in WRONG])
def test_what_is_wrong_with_a_template_is_one_sentence_with_its_line(
    table: Callable[..., Table],
    tmp_path: FilePath,
    refuses: Callable[..., None],
    case: tuple[str, ...],
) -> None:
    (tmp_path / "part.j2").write_text("one\n{% if %}\n")
    file = house(tmp_path, case[0])
    refuses(lambda: made(table(), tmp_path, file), InvalidInput, *case[1:])


def test_refuses_templates_that_are_not_there(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    refuses(lambda: made(table(), tmp_path, "fanuc"), InvalidInput, "'fanuc'", "kuka", "abb")
    refuses(
        lambda: made(table(), tmp_path, tmp_path / "no.j2"), InvalidInput, "There is no template"
    )
    (tmp_path / "folder.j2").mkdir()
    os.mkfifo(tmp_path / "pipe.j2")
    for name, words in (("folder", "Is a directory"), ("pipe", "not a regular file")):
        refuses(
            lambda name=name: made(table(), tmp_path, tmp_path / f"{name}.j2"), InvalidInput, words
        )
    refuses(lambda: made(table(), tmp_path, "a\0b"), InvalidInput, "There is no template")
    refuses(lambda: made(table(), tmp_path, "a" * 5000), InvalidInput, "There is no template")
    latin = tmp_path / "latin.j2"
    latin.write_bytes(b"\xe9")
    refuses(lambda: made(table(), tmp_path, latin), InvalidInput, "not UTF-8")


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("how", ["include", "import", "extends"])
def test_a_template_takes_others_only_from_its_folder(
    table: Callable[..., Table], tmp_path: FilePath, refuses: Callable[..., None], how: str
) -> None:
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

    def of(name: str) -> FilePath:
        file = folder / "main.j2"
        file.write_text(f"{{% {how} '{name}'{end} %}}")
        return file

    for name, words in (
        ("out.j2", "leads out of the folder"),
        ("up/secret.txt", "leads out of the folder"),
        ("gone.j2", "There is no template"),
        ("pipe.j2", "not a regular file"),
        ("../secret.txt", "no template '../secret.txt'"),
        (str(outside), "no template"),
    ):
        file = of(name)
        refuses(lambda: made(table(), tmp_path, file), InvalidInput, "main.j2", words)  # noqa: B023
    for name in ("inside.j2", "parts/head.j2"):
        text = made(table(), tmp_path, of(name))
        assert text == ("" if how == "import" else "HEAD")
