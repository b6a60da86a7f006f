"""Troubleshooting page: each quoted message is printed in the described case."""

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml
from docs.pages import run_command
from markdown_it import MarkdownIt

from armcontour.cli.console import ProgressDisplay
from armcontour.core.progress import listen_to_compilation, report_compiling

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/guides/troubles.md"
GASKET = (ROOT / "examples/drawings/gasket.dxf").read_bytes()
# A job without trouble, and one in space; troubles change single keys of them.
BEND = yaml.safe_load("""
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {}}
""")
SEAM = BEND | {
    "arm": "ur5e",
    "path": {"points": [[0.4, -0.3, 0.2], [0.4, 0.3, 0.2]], "orientation": {"axis": [0, 0, -1]}},
}
GCODE = "G21 G90 F600\nG0 X0 Y0\nG1 X50 Y0\n{}\nG1 X50 Y40\nM2\n"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
RUN = "armcontour run job.yaml --out out --no-simulation"
SIMULATED = "armcontour run job.yaml --out out"
SHOW = "armcontour show part.dxf"
STEPS = "t,u1,q1\n" + "".join(f"{k / 250},{k * 1e-4},{k // 2 * 2e-4}\n" for k in range(200))
LINE = "t,q1,q2\n" + "".join(f"{k / 250},{0.1 + k * 4e-4:.3f},1.0\n" for k in range(200))
# A description as makers write it: six joints, no accelerations, and 0 for unknown torques.
JOINTS = ("0 0 .4;0 0 1", ".1 0 0;0 1 0", "0 0 .5;0 1 0", ".05 0 0;1 0 0", ".45 0 0;0 1 0",
          "0 0 .1;1 0 0")  # fmt: skip
URDF = "".join(
    f'<link name="l{k}"/><joint name="joint_{k + 1}" type="revolute"><parent link="l{k}"/>'
    f'<child link="l{k + 1}"/><origin xyz="{place}"/><axis xyz="{axis}"/>'
    '<limit lower="-3" upper="3" velocity="2" effort="0"/></joint>'
    for k, (place, axis) in enumerate(x.split(";") for x in JOINTS)
)


@dataclass
class Trouble:
    """What provokes a trouble."""

    command: str = RUN
    files: dict = field(default_factory=dict)
    job: dict = field(default_factory=lambda: BEND)


def drawn(words, more="", cell="pmk3s"):
    """A program of G-code with one more line, on an arm."""
    command = f"armcontour run part.ngc --cell {cell} --out out --no-simulation {more}"
    return Trouble(command, {"part.ngc": GCODE.format(words)})


def gasket(command, content=GASKET):
    return Trouble(command, {"part.dxf": content})


def changed(job=BEND, command=RUN, files=None, **keys):
    """A job with other keys."""
    return Trouble(command, files or {}, job | keys)


RANGE = {"joint_lower": [-0.2, -6, -3, -6, -6, -6], "joint_upper": [0.3, 6, 3, 6, 6, 6]}
RAIL = {"axis": [0, 1, 0], "lower": 0, "upper": 3, "velocity": 1, "acceleration": 1}
HELD = {"name": "ur5e", "rail": RAIL, "preferences": {"rail": {"hold": 0}}}
FAR = {"points": [[0.4, 2, 0.2], [0.4, 2.6, 0.2]], "orientation": {"axis": [0, 0, -1]}}
EARLY = {"switch": {"name": "laser", "on_lead": "200 ms"}}
PAPER = {"paper": {"timing": {"method": "paper"}}}
TROUBLES = {
    "Out of reach": drawn("", "--position '1.2 m, 0 m, 100 mm'", "ur5e"),
    "Out of reach by hundreds of metres": changed(path={"points": [[300, 200], [400, 200]]}),
    "A joint at the end of its range": changed(SEAM, limits=RANGE),
    "An axis that is held": changed(SEAM, arm=HELD, path=FAR),
    "A singularity": changed(path={"points": [[0.135, 0.3], [0.135, 0.465]]}),
    "A collision": drawn("", "--position '350 mm, -100 mm, -50 mm'", "ur5e"),
    "Not realizable": changed(
        path={"points": [[-0.065, 0.30], [0.335, 0.30]]}, limits={"speed": "0.3 m/s"}, runs=PAPER
    ),
    "Nothing limits the acceleration": changed(
        SEAM, RUN, {"robot.urdf": f'<robot name="robot">{URDF}<link name="l6"/></robot>'},
        arm={"file": "robot.urdf", "tip": "l6"},
        limits={"speed": "0.1 m/s", "joint_acceleration": "inf"},
    ),
    "A stop at a sharp corner": changed(limits={"joint_jerk": 10}, corners="sharp"),
    "A contour that is too short for its speed": changed(
        path={"points": [[0.30, 0.20], [0.303, 0.20]]}, corners="sharp",
        process={"lead_in": {"length": "30 mm"}, "switch": {"name": "laser"}},
    ),
    "An event before the motion": changed(process=EARLY),
    "Demand above the limit: the servo saturates": changed(
        command=SIMULATED, limits={"speed": "0.2 m/s", "centripetal_acceleration": "0.3 m/s^2"},
        cycle="20 ms", runs={"only": {"compensation": {"method": "inverse"}}},
    ),
    "The certificate fails": changed(
        command="armcontour certify job.yaml --servo-error '0.01 um'",
        runs={"only": {"compensation": {"method": "pole_placement"}}},
    ),
    "A drawing without a unit": gasket(SHOW, GASKET.replace(b"INSUNITS", b"INSUNITZ")),
    "The servo is not determined": Trouble("armcontour identify log.csv", {"log.csv": STEPS}),
    "Cannot tell": Trouble("armcontour check log.csv --arm pmk3s", {"log.csv": LINE}),
}  # fmt: skip


def sections():
    """Every heading with the sentence below it, on one line."""
    heading = ""
    tokens = MarkdownIt().parse(PAGE.read_text(encoding="utf-8"))
    for i, token in enumerate(tokens):
        if token.type == "heading_open":
            heading = tokens[i + 1].content
        elif token.type == "fence" and token.info == "text":
            yield heading, " ".join(token.content.split())


SAID = dict(sections())


@pytest.mark.parametrize("name", TROUBLES)
def test_the_page_quotes_the_messages_of_the_commands(name, tmp_path, monkeypatch):
    trouble = TROUBLES[name]
    monkeypatch.chdir(tmp_path)
    for file, content in (trouble.files | {"job.yaml": yaml.safe_dump(trouble.job)}).items():
        Path(file).write_bytes(content if isinstance(content, bytes) else content.encode())
    _, *arguments = shlex.split(trouble.command)
    monkeypatch.setenv("COLUMNS", "200")
    _, out, errors = run_command(arguments)
    output = " ".join((out + errors).split())
    words = NUMBER.split(SAID[name])
    match = re.search(f"({NUMBER.pattern})".join(map(re.escape, words)), output)
    assert match, output
    # Last digits may differ from machine to machine.
    expected = [float(x) for x in NUMBER.findall(SAID[name])]
    assert [float(x) for x in match.groups()] == pytest.approx(expected, rel=0.01)


def test_every_sentence_on_the_page_is_provoked(capsys):
    with listen_to_compilation(ProgressDisplay("run").note_compilation):
        report_compiling("armcontour.robot.pose_solver.solve")
    assert capsys.readouterr().err == SAID["The first run is slow"] + "\n"
    assert SAID.keys() - {"The first run is slow"} == TROUBLES.keys()
