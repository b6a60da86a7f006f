"""The code on the pages: Python runs, commands parse, and YAML is what its reader takes.

The tutorials are done as a reader does them, in an empty folder: every block in order, and what is
printed is what the page says. `docs/pages.py` explains the marks of blocks.
"""

import re
import shlex
import shutil
from pathlib import Path

import click
import jsonschema
import numpy as np
import pytest
import typer
import yaml
from docs.pages import agree, blocks, read_page, run_command, run_python
from markdown_it import MarkdownIt
from soak.identification import move
from tests.dynamics_extra import mark_all_but, needs_dynamics

import armcontour as ac
from armcontour.cli.commands import program_for
from armcontour.files import json_schema, parse_job
from armcontour.files.drawings.path_reader import READERS
from armcontour.files.job_file import read_cell
from armcontour.files.limits_and_servo_files import read_limits

ROOT = Path(__file__).parents[1]
# `make docs` copies pages; the originals in the repository are tested.
BUILT = ("docs/_build/", "docs/gallery/", "docs/reference/pages/", "docs/reference/job_keys.md")
FOUND = [
    *ROOT.glob("*.md"),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").rglob("*.md")),
]
PAGES = {place: x for x in FOUND if not (place := x.relative_to(ROOT).as_posix()).startswith(BUILT)}
COMMAND = re.compile(r"^(?:\.venv/bin/)?(armcontour .*)$", re.MULTILINE)
SCHEMA = json_schema()
# A part of a job. `jsonschema.validate` would check the schema itself again for each block; that it
# is one is checked in tests/files/test_job_file.py.
PART = jsonschema.Draft202012Validator({**SCHEMA, "required": []})
BLOCKS = [x for file in PAGES.values() for x in blocks(file)]
# Pages that are executed from begin to end, with the output that they print.
DONE = [
    *("docs/start/first_result.md", "docs/start/ur5e.md", "docs/guides/measure.md"),
    "docs/guides/step.md",
    *(x for x in PAGES if x.startswith(("docs/tutorials/", "docs/processes/"))),
]
# Those that the suite does; tests/slow does the others.
QUICK = ("docs/start/first_result.md", "docs/guides/measure.md")
# Pages with clearance or models of pinocchio.
NEEDING = {"docs/concepts/clearance.md", "docs/guides/arms.md", "docs/start/coming_from.md"}
PYTHON = sorted({x.page for x in BLOCKS if x.language == "python"} - {*DONE})
GROUP = typer.main.get_command(program_for())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Makes the folder that a page speaks of: sample drawings, a robot, and its own files."""

    def make(page):
        folder_of_page = tmp_path / page.replace("/", " ")
        folder_of_page.mkdir(exist_ok=True)
        for x in (folder_of_page, folder_of_page / "examples/drawings"):
            shutil.copytree(ROOT / "examples/drawings", x, dirs_exist_ok=True)
        data = ROOT / "tests/files/robots/data"
        shutil.copy(data / "joint_limits.yaml", folder_of_page)
        robot = (data / "robot.urdf").read_text(encoding="utf-8").replace('"tcp"', '"tool0"')
        robot = robot.replace('name="lift" type="prismatic"', 'name="lift" type="fixed"')
        (folder_of_page / "robot.urdf").write_text(robot, encoding="utf-8")
        job = yaml.safe_load(next(x for x in BLOCKS if x.marks.get("file") == "square.yaml").text)
        job |= {"arm": {"file": "robot.urdf"}}
        (folder_of_page / "job.yaml").write_text(yaml.safe_dump(job), encoding="utf-8")
        for block in blocks(PAGES[page]):
            if "file" in block.marks:
                (folder_of_page / block.marks["file"]).write_text(block.text, encoding="utf-8")
        monkeypatch.chdir(folder_of_page)
        return folder_of_page

    return make


def run_page(page, names):
    """Run the Python of a page, and before it of the page that it continues; what is printed."""
    printed = ""
    for block in blocks(PAGES[page]):
        if "continues" in block.marks:
            printed += run_page(block.marks["continues"], names)
        if block.language == "python" and "not run" not in block.marks:
            if 'read_log("log.csv")' in block.text:
                write_log(Path("log.csv"), names["t"], names["u"])
            printed += run_python(block, names)
    return printed


def write_log(file, t, u):
    """What a joint with gains of 25 and 150 1/s, 12 ms late, makes of a page's command."""
    # 250 Hz are as good for this test and sooner done.
    t = t[::4]
    u = u[::4]
    measured = move(t, u, kp=25.0, kv=150.0, delay=12e-3)
    measured = measured + 1e-5 * np.random.default_rng(0).normal(size=len(t))
    table = np.column_stack([t, u, measured])
    head = "# interpolation: linear\nt,command 1,measured 1"
    np.savetxt(file, table, fmt="%.9f", delimiter=",", header=head, comments="")


def do_page(page):
    """Do a page in the current folder, and compare what is printed."""
    for block, printed in read_page(PAGES[page]):
        within = float(block.marks.get("within", "0 %").removesuffix(" %")) / 100
        assert agree(block.text, printed, within=within), f"{block} is, as printed:\n{printed}"


@pytest.mark.parametrize("page", QUICK)
def test_the_steps_of_a_page_give_the_printed_output(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    do_page(page)


@pytest.mark.parametrize("page", mark_all_but(PYTHON, {*PYTHON} - NEEDING))
def test_python_blocks_of_pages_run(page, folder):
    folder(page)
    names = {"__name__": page}
    printed = run_page(page, names)
    if page == "README.md":
        _, expected = (x.text for x in blocks(PAGES[page]) if x.language == "text")
        assert agree(expected, printed)
    if page == "docs/guides/identify.md":
        assert names["identification"]["joint 1"].kp.value == pytest.approx(25.0, rel=0.01)


@needs_dynamics
def test_the_command_of_the_readme_prints_the_stated_lines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "examples/drawings", tmp_path / "examples/drawings")
    (line,) = (x for page, x in command_lines() if page == "README.md" and " run " in x)
    code, printed, errors = run_command(shlex.split(line)[1:])
    assert code == 0, errors
    stated = next(x.text for x in blocks(PAGES["README.md"]) if x.language == "text")
    assert agree(stated, printed)


def command_lines():
    for x in BLOCKS:
        if x.language in ("", "sh"):
            yield from ((x.page, y) for y in COMMAND.findall(x.text.replace("\\\n", " ")))


def test_command_lines_of_pages_parse():
    wrong = []
    for page, line in command_lines():
        _, name, *arguments = shlex.split(line)
        try:
            GROUP.commands[name].make_context(name, arguments)
        except (click.ClickException, KeyError) as error:
            wrong.append(f"{page}: {line}: {error}")
    assert not wrong


@needs_dynamics
def test_the_first_command_of_a_page_succeeds(folder):
    # The page's own file is what it runs.
    for page in (f"docs/guides/{x}.md" for x in ("gcode", "waypoints", "job", "checking")):
        folder(page)
        line = next(words for page_of_line, words in command_lines() if page_of_line == page)
        _, *arguments = shlex.split(line)
        code, _, errors = run_command([*arguments, "--no-simulation"])
        assert code == 0, errors


def options_of(command):
    return {x for parameter in command.params for x in [*parameter.opts, *parameter.secondary_opts]}


def test_commands_and_options_in_texts_exist():
    all_options = set().union(*map(options_of, GROUP.commands.values()))
    wrong = []
    for page, file in PAGES.items():
        tokens = MarkdownIt().enable("table").parse(file.read_text(encoding="utf-8"))
        inline = [y for x in tokens for y in x.children or ()]
        spans = [x.content for x in inline if x.type == "code_inline"]
        for words in (x for x in spans if x.startswith(("armcontour ", "--"))):
            first, *arguments = shlex.split(words)
            is_command = first == "armcontour"
            options_available = (
                options_of(GROUP.commands[arguments[0]]) if is_command else all_options
            )
            options = {x for x in (arguments if is_command else [first]) if x.startswith("--")}
            wrong += [f"{page}: {x}" for x in options - options_available]
    assert not wrong


def read_yaml(block, folder_of_page):
    """Read a block by the reader that it is for."""
    data = yaml.safe_load(block.text)
    if set(SCHEMA["required"]) <= set(data):
        if {"points", "segments", "spline", "file"} & set(data["path"]):
            parse_job(block.text, source=str(block), folder=folder_of_page)
        else:
            (folder_of_page / "cell.yaml").write_text(block.text, encoding="utf-8")
            read_cell("cell.yaml", folder_of_page / "gasket.dxf")
    elif "kind" in data:
        (folder_of_page / "arm.yaml").write_text(block.text, encoding="utf-8")
        ac.load_arm("arm.yaml")
    elif set(data) <= set(SCHEMA["properties"]):
        PART.validate(data)
    else:
        (folder_of_page / "limits.yaml").write_text(block.text, encoding="utf-8")
        read_limits("limits.yaml", ac.load_arm("pmk3s"))


def test_yaml_blocks_and_drawings_are_accepted_by_their_readers(folder):
    for block in BLOCKS:
        # Files of a page that is done are read when it is.
        if "file" in block.marks and block.page in DONE:
            continue
        if block.language == "yaml":
            read_yaml(block, folder(block.page))
        elif Path(block.marks.get("file", "")).suffix in READERS:
            drawing = folder(block.page) / block.marks["file"]
            assert ac.read_path(drawing).contours, str(block)


def test_every_code_block_is_tested_or_states_a_reason():
    """A code block in a language that the tests do not run would be untested."""
    ways = {"python", "yaml", "text", "", "{toctree}"}
    for block in BLOCKS:
        done = block.language == "sh" and block.page in DONE
        explained = {"file", "not run"} & set(block.marks)
        assert block.language in ways or done or explained, f"{block}: {block.language} is not run"
