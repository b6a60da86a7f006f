"""Optional dependencies, compilation, printing and progress of commands."""

import sys
import tomllib
from pathlib import Path as FilePath

import pytest
from tests.cli.helpers import summary

from armcontour.cli.command_execution import execute
from armcontour.cli.commands import Studio
from armcontour.cli.studio_command import studio
from armcontour.core.errors import InvalidInput

ROOT = FilePath(__file__).parents[2]
# Extras for those who develop armcontour.
FOR_DEVELOPERS = {"browser", "test", "docs", "bench", "dev"}
JOB = """name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.40, 0.20], [0.40, 0.30]]}
limits: {speed: 0.10 m/s}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 20 ms
runs: {plain: {compensation: {method: none}}}
"""
SCENE = "{obstacles: [{type: sphere, name: ball, radius: 10 mm, at: [1, 1, 0]}]}"
# By extra: a library that it brings, and command lines that need it.
NEEDS = {
    "dynamics": ("coal", ["run cell.yaml --out out", "check a.csv --arm ur5e --scene ur5e"]),
    "experiment": ("mujoco", ["run bodies.yaml --out out"]),
    "cad": ("OCP", ["show a.step", "run a.step --cell ur5e --out out"]),
    "drawings": ("ezdxf", ["show a.dxf", "run a.dxf --cell ur5e --out out"]),
    "studio": ("uvicorn", ["studio --no-open"]),
    "ros": (
        "rosbags",
        ["identify a.mcap", "check a.db3 --arm ur5e", "run job.yaml --out out --export mcap"],
    ),
}


@pytest.fixture
def folder(tmp_path):
    """A folder with the files of these command lines; those of other formats are empty."""
    (tmp_path / "job.yaml").write_text(JOB)
    (tmp_path / "bodies.yaml").write_text(f"{JOB}experiment: {{}}\n")
    (tmp_path / "cell.yaml").write_text(f"{JOB}scene: {SCENE}\n")
    rows = (f"{t},0.1,-1.5,1.2,-1,-1.5,0\n" for t in (0.0, 0.1, 0.2))
    (tmp_path / "a.csv").write_text(f"t,q1,q2,q3,q4,q5,q6\n{''.join(rows)}")
    (tmp_path / "a.dxf").write_bytes(b"")
    (tmp_path / "a.step").write_bytes(b"")
    (tmp_path / "a.mcap").write_bytes(b"")
    (tmp_path / "a.db3").write_bytes(b"")
    return tmp_path


def test_a_test_covers_every_optional_dependency_of_users():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    # Tests of franka's adapter are in tests/controllers.
    users = set(project["optional-dependencies"]) - FOR_DEVELOPERS - {"franka"}
    assert users == set(NEEDS)


@pytest.mark.parametrize("extra", NEEDS)
def test_a_missing_extra_is_named(command_in, folder, monkeypatch, extra):
    library, lines = NEEDS[extra]
    monkeypatch.setitem(sys.modules, library, None)
    for line in lines:
        ended = command_in(folder, *line.split())
        assert ended.code == 2, line
        assert f"pip install 'armcontour[{extra}]'" in ended.errors, line
        assert library.partition(".")[0] in ended.errors, line
        errors = [x for x in ended.errors.splitlines() if x.startswith("Error: ")]
        assert len(errors) == 1 and "Traceback" not in ended.errors, line
        assert not (folder / "out").exists(), line


def test_the_demo_needs_no_extra(done, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for library in ("coal", "pinocchio", "mujoco", "ezdxf", "OCP"):
        monkeypatch.setitem(sys.modules, library, None)
    done("demo", "--out", "out")
    paper, plate = (summary(tmp_path / "out" / name) for name in ("", "plate"))
    assert list(paper["runs"]) == ["conventional", "proposed", "shaped"]
    # The figures of docs/start/installing.md.
    errors = {name: x["contour_error"]["rms"] for name, x in paper["runs"].items()}
    assert errors["proposed"] == pytest.approx(2.31e-6, rel=0.01)
    assert errors["conventional"] == pytest.approx(3.583e-3, rel=0.01)
    contours = [x for x in plate["runs"]["cut"]["moves"] if x["kind"] == "contour"]
    # The outline is cut last.
    assert len(contours) == 3 and contours[-1]["name"] == "path 1"
    for name in (*paper["files"], *(f"plate/{x}" for x in plate["files"])):
        assert (tmp_path / "out" / name).is_file()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for job in (paper, plate):
        assert f'id="{job["job"]}-figures"' in page
    # The demo does not replace changed files.
    (tmp_path / "out" / "report.html").write_text("mine")
    assert command("demo", "--out", "out").code == 2
    assert (tmp_path / "out" / "report.html").read_text() == "mine"


def test_the_studio_prints_and_opens_its_address(tmp_path, monkeypatch, capsys):
    from armcontour.studio import server

    (tmp_path / "job.yaml").write_text("[")
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr(server, "listen", lambda port, listen=server.listen: listen(0))
    with pytest.raises(InvalidInput, match="job.yaml"):
        execute(studio, Studio(job=tmp_path / "job.yaml"))
    printed = capsys.readouterr().out.splitlines()
    address = printed[0].removeprefix("Studio: ")
    assert address.startswith("http://127.0.0.1:") and len(address.partition("#")[2]) == 32
    assert opened == [address] and "Ctrl+C" in printed[1]
