"""Before the first set-point, exported programs move every axis slowly; times and names add up."""

import dataclasses
import re

import numpy as np
import pytest
import yaml

from armcontour.files.exports import CsvFormat, RosYamlFormat, TemplateFormat, URScriptFormat

# Largest speeds of the slow move: share of an axis' largest speed [%], tool and rail [mm/s], tool
# and external axes [deg/s], joints [rad/s].
SLOW_PERCENT = 10
SLOW_MM = 50
SLOW_DEG = 10
SLOW_RAD = 0.2
NUMBER = r"[-+\d.E]+"


def with_external(table, count, prismatic):
    """A table of an arm with external axes first, as armcontour orders them."""
    made = table(6 + count, count=40, events=())
    slides = tuple(k in prismatic for k in range(6 + count))
    return dataclasses.replace(made, prismatic=slides, external=tuple(range(count)))


CELLS = [(0, ()), (1, (0,)), (1, ()), (3, (2,)), (6, (0, 1, 2))]


def kuka_speeds(lines):
    """Values of $VEL_AXIS and $VEL_EXTAX after some lines, by name and axis, loops executed."""
    values = {}
    loop = []
    for line in lines:
        if match := re.fullmatch(r"FOR I = (\d+) TO (\d+)", line):
            loop = range(int(match[1]), int(match[2]) + 1)
        elif line == "ENDFOR":
            loop = []
        elif match := re.fullmatch(r"\$(VEL_AXIS|VEL_EXTAX)\[(I|\d+)\] = (\d+)", line):
            axes = loop if match[2] == "I" else [int(match[2])]
            values |= {(match[1], k): int(match[3]) for k in axes}
    return values


@pytest.mark.parametrize(("count", "prismatic"), CELLS)
def test_a_kuka_program_moves_every_axis_slowly_to_its_start(table, tmp_path, count, prismatic):
    made = with_external(table, count, prismatic)
    file = tmp_path / "made.src"
    TemplateFormat(template="kuka").write(made, file)
    lines = [x.strip() for x in file.read_text().splitlines()]
    (start,) = (i for i, x in enumerate(lines) if x.startswith("PTP {"))
    spline = lines.index("PTP_SPLINE")
    moved = re.findall(r"([AE])(\d) ", lines[start])
    assert len(moved) == 6 + count
    names = {"A": "VEL_AXIS", "E": "VEL_EXTAX"}
    before = kuka_speeds(lines[:start])
    assert {before[names[x], int(k)] for x, k in moved} == {SLOW_PERCENT}
    # The spline needs the whole speed of the same axes.
    assert kuka_speeds(lines[:spline]) == dict.fromkeys(before, 100)
    assert start < spline


@pytest.mark.parametrize(("count", "prismatic"), CELLS)
def test_an_abb_program_moves_every_axis_slowly_to_its_start(table, tmp_path, count, prismatic):
    made = with_external(table, count, prismatic)
    file = tmp_path / "made.mod"
    TemplateFormat(template="abb").write(made, file)
    text = file.read_text()
    declared = rf"CONST speeddata (\w+) := \[({NUMBER}), ({NUMBER}), ({NUMBER}), ({NUMBER})\];"
    ((name, *values),) = re.findall(declared, text)
    tool, rotation, linear, rotating = map(float, values)
    assert 0 < tool <= SLOW_MM and 0 < linear <= SLOW_MM
    assert 0 < rotation <= SLOW_DEG and 0 < rotating <= SLOW_DEG
    moves = [x.strip() for x in text.splitlines() if x.strip().startswith("MoveAbsJ")]
    assert moves[0].endswith(f"]], {name}, fine, tool0;")
    assert not any(f", {name}," in x for x in moves[1:])
    # Two programs in one controller each have their own speeds.
    assert "LOCAL CONST speeddata" in text


def test_urscript_moves_slowly_and_tables_begin_with_the_first_set_point(table, tmp_path):
    made = table(6, count=9, events=())
    file = tmp_path / "made.script"
    URScriptFormat().write(made, file)
    moves = [x.strip() for x in file.read_text().splitlines() if re.match(r"\s*\w+j\(\[", x)]
    start = re.fullmatch(r"movej\(\[([^\]]*)\], a=([\d.]+), v=([\d.]+)\)", moves[0])
    assert float(start[3]) <= SLOW_RAD and float(start[2]) <= 0.3
    np.testing.assert_allclose([float(x) for x in start[1].split(",")], made.q[0], atol=1e-6)
    assert all(x.startswith("servoj") for x in moves[1:])
    for count, prismatic in CELLS:
        made = with_external(table, count, prismatic)
        CsvFormat().write(made, tmp_path / "made.csv")
        first = (tmp_path / "made.csv").read_text().splitlines()[1].split(",")
        expected = [0.0, *made.q[0], *made.dq[0], *made.ddq[0]]
        np.testing.assert_allclose([float(x) for x in first], expected, atol=1e-6)
        RosYamlFormat().write(made, tmp_path / "made.yaml")
        point = yaml.safe_load((tmp_path / "made.yaml").read_text())["points"][0]
        assert point["time_from_start"] == {"sec": 0, "nanosec": 0}
        np.testing.assert_allclose(point["positions"], made.q[0], atol=1e-6)


def times_in_kuka(text):
    """Times of the points of a KUKA program [s]: the last part is the rest."""
    parts = [float(x) for x in re.findall(r"TIME_BLOCK PART = ([\d.]+)", text)]
    (whole,) = re.findall(r"TIME_BLOCK END = ([\d.]+)", text)
    return np.append(np.cumsum([0.0, *parts]) / 100, 1.0) * float(whole)


def times_in_abb(text):
    return np.cumsum([0.0, *(float(x) for x in re.findall(r"\\T:=([\d.]+)", text))])


@pytest.mark.parametrize("cycle", [0.002, 0.004, 1 / 300, 0.012, 0.048])
@pytest.mark.parametrize("count", [2, 61, 6001])
def test_times_of_a_program_do_not_accumulate_rounding_errors(table, tmp_path, cycle, count):
    made = table(6, count=count, events=())
    t = np.arange(count) * cycle
    # The last interval of a sampled plan is shorter.
    t[-1] -= 0.37 * cycle
    made = dataclasses.replace(made, t=t, cycle=cycle)
    for template, times_of, digit in (("kuka", times_in_kuka, 1e-9), ("abb", times_in_abb, 1e-6)):
        file = tmp_path / "made.txt"
        TemplateFormat(template=template).write(made, file)
        times = times_of(file.read_text())
        # Percentages with 9 decimals, and times with half a digit.
        within = 0.51 * digit + 0.51e-11 * t[-1]
        np.testing.assert_allclose(times, t, rtol=0, atol=within)
        np.testing.assert_allclose(np.diff(times), np.diff(t), rtol=0, atol=2 * within)


NAMES = [
    *("reference", "run reference", "m reference", "test", "m_test", "run_test", "7", "m_7", "ö"),
    *("ü", "a-b", "a.b", "a b"),
    *(f"{'long name of a job ' * 4}{x}" for x in ("reference", "set_points", "run a", "run b")),
    *(f"{30 * 'a'}{x}" for x in "bcd"),
    *(f"{x} {32 * 'a'}" for x in ("run", "m")),
]


def test_programs_of_different_exports_have_different_names(table, tmp_path):
    names = []
    scripts = []
    for name in NAMES:
        made = dataclasses.replace(table(6, events=()), name=name)
        TemplateFormat(template="abb").write(made, tmp_path / "made.mod")
        text = (tmp_path / "made.mod").read_text()
        names += re.findall(r"^MODULE (\w+)$", text, re.M)
        names += re.findall(r"^  PROC (\w+)\(\)$", text, re.M)
        URScriptFormat(call=True).write(made, tmp_path / "made.script")
        lines = (tmp_path / "made.script").read_text().splitlines()
        scripts += re.findall(r"^def (\w+)\(\):", lines[0])
        assert lines[-1] == f"{scripts[-1]}()"
    # Modules and global procedures share one name space, which ignores upper case.
    assert len(names) == len({x.lower() for x in names}) == 2 * len(NAMES)
    assert all(re.fullmatch(r"[A-Za-z]\w{0,31}", x, re.ASCII) for x in names)
    assert len(set(scripts)) == len(NAMES) and max(map(len, scripts)) <= 31


def test_a_signal_must_not_have_a_name_of_its_program(table, tmp_path):
    made = dataclasses.replace(table(6), name="part")
    for signal in ("part", "Run_Part", "SLOW"):
        with pytest.raises(ValueError, match="signal name"):
            TemplateFormat(template="abb", outputs={"tool": signal}).write(made, tmp_path / "x.mod")
