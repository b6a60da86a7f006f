"""Drawings in job files and in cells: what becomes of the file, and what is refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io import parse_job, read_job
from armcontour.io.cell import cell_names, read_cell
from armcontour.io.robots.loading import arm_names
from armcontour.jobs import Job
from armcontour.program import Program

TWO = "contour,x [mm],y [mm]\na,0,0\na,60,0\nb,0,30\nb,60,30\nb,60,60\nb,0,30\n"
PLAIN = "x [mm],y [mm]\n0,0\n60,0\n60,40\n"
JOB: dict[str, Any] = {
    "name": "plate",
    "arm": "pmk3s",
    "path": {"file": "two.csv", "frame": {"position": ["300 mm", "80 mm", 0]}},
    "limits": {"speed": "50 mm/s", "centripetal_acceleration": "0.09 m/s^2"},
    "corners": {"tolerance": "0.5 mm"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"taught": {"timing": {"method": "optimal"}, "compensation": {"method": "inverse"}}},
}


@pytest.fixture
def folder(tmp_path: FilePath) -> FilePath:
    (tmp_path / "two.csv").write_text(TWO)
    (tmp_path / "plain.csv").write_text(PLAIN)
    return tmp_path


def job(folder: FilePath, **changes: Any) -> Job:
    path = {**JOB["path"], **changes.pop("path", {})}
    text = yaml.safe_dump({**JOB, "path": path, **changes})
    return parse_job(text, source="plate.yaml", folder=folder)


def test_a_file_becomes_a_program_where_its_frame_lies(folder: FilePath) -> None:
    program = job(folder).path
    assert isinstance(program, Program)
    assert [x.name for x in program.contours] == ["a", "b"]
    np.testing.assert_allclose(program.contours[0].path.vertices, [[0.3, 0.08], [0.36, 0.08]])
    turned = job(folder, path={"frame": {"position": [0.3, 0.1, 0], "rpy": [0, 0, "90 deg"]}}).path
    assert isinstance(turned, Program)
    np.testing.assert_allclose(turned.contours[0].path(0.06), [0.3, 0.16], atol=1e-15)
    scaled = job(folder, path={"scale": 0.5, "names": ["b"]}).path
    assert isinstance(scaled, Program) and len(scaled.contours) == 1
    np.testing.assert_allclose(scaled.length, 0.045 + 0.5 * np.hypot(0.06, 0.03), atol=1e-15)


def test_a_file_of_one_plain_contour_is_a_job_of_one_path(
    folder: FilePath, refuses: Callable[..., None]
) -> None:
    plain = job(folder, path={"file": "plain.csv"})
    assert plain.single_path.length == pytest.approx(0.1)
    with_leads = job(folder, path={"file": "plain.csv"}, process={"lead_in": {"length": "5 mm"}})
    refuses(lambda: with_leads.single_path, InvalidInput, "with other moves")
    automatic = job(folder, path={"file": "plain.csv"}, process={"lead_out": {}})
    assert automatic.objective is None and automatic.process.automatic
    refuses(lambda: automatic.single_path, InvalidInput, "with other moves")
    points = {**JOB, "path": {"points": [[0.3, 0.1], [0.36, 0.1]]}}
    switched = parse_job(yaml.safe_dump({**points, "process": {"switch": {"name": "laser"}}}))
    assert switched.process.switch is not None
    refuses(lambda: switched.single_path, InvalidInput, "with other moves")


def test_a_drawing_is_repeated_in_its_own_coordinates(
    folder: FilePath, refuses: Callable[..., None]
) -> None:
    repeat = {"columns": 2, "rows": 2, "column_spacing": "70 mm", "row_spacing": "80 mm"}
    turned = {"position": [0.3, 0.1, 0], "rpy": [0, 0, "90 deg"]}
    program = job(folder, path={"repeat": repeat, "scale": 0.5, "frame": turned}).program
    order = [f"{x} {y}" for y in ("[1,1]", "[1,2]", "[2,2]", "[2,1]") for x in "ab"]
    assert [x.name for x in program.contours] == order
    # 70 mm along the drawing's x, which is y here, and 80 mm along its y.
    np.testing.assert_allclose(program.contours[4].path(0.0), [0.22, 0.17], atol=1e-12)
    one = job(folder, path={"repeat": repeat, "names": ["a [2,1]"]}).program
    assert [x.name for x in one.contours] == ["a [2,1]"]
    all_of = job(folder, path={"repeat": repeat, "names": ["b"]}).program
    assert [x.name for x in all_of.contours] == [x for x in order if x[0] == "b"]
    wrong = {"columns": 2}
    refuses(lambda: job(folder, path={"repeat": wrong}), InvalidInput, "path.repeat", "column_sp")
    unknown = {"repeat": repeat, "names": ["c [1,1]"]}
    refuses(lambda: job(folder, path=unknown), InvalidInput, "no contour 'c [1,1]'", "'a [1,1]'")
    points = {**JOB, "path": {"points": [[0.3, 0.1], [0.36, 0.1]], "repeat": repeat}}
    refuses(lambda: parse_job(yaml.safe_dump(points)), InvalidInput, "path.repeat", "path.file")


def test_a_process_is_read_with_its_units(folder: FilePath) -> None:
    process = job(
        folder,
        process={
            "begin": ["300 mm", "110 mm"],
            "overlap": "2 mm",
            "lead_in": {"length": "5 mm", "shape": "arc", "side": "right", "active": True},
            "lead_out": {"length": "auto"},
            "pierce": {"time": "300 ms", "height": "3 mm"},
            "switch": {"name": "laser", "on_lead": "20 ms", "off_lead": "5 ms"},
            "events": [{"name": "gas", "value": 2.5, "at": "1 mm", "lead_time": "-10 ms"}],
            "analog": [{"name": "power", "rest": "20 %", "speed": "100 mm/s", "lead_time": "5 ms"}],
            "from_s": "12 mm",
            "order": "shortest",
            "reverse_open": True,
            "kerf": "0.2 mm",
            "kerf_side": "left",
        },
    ).process
    assert (process.order, process.reverse_open) == ("shortest", True)
    assert (process.kerf, process.kerf_side) == (0.0002, "left")
    assert process.begin == pytest.approx((0.3, 0.11)) and process.overlap == 0.002
    assert process.lead_in is not None and process.lead_out is not None
    assert (process.lead_in.length, process.lead_in.shape, process.lead_in.side) == (
        0.005,
        "arc",
        "right",
    )
    assert process.lead_in.active and not process.lead_out.active
    assert process.pierce is not None
    assert (process.pierce.time, process.pierce.height) == (0.3, 0.003)
    assert process.lead_out.length is None
    assert process.switch is not None
    assert (process.switch.on_lead, process.switch.off_lead) == (0.02, 0.005)
    (event,) = process.events
    assert (event.name, event.value, event.s, event.lead_time) == ("gas", 2.5, 0.001, -0.01)
    assert process.from_s == 0.012
    (analog,) = process.analog
    assert (analog.name, analog.rest, analog.full, analog.off) == ("power", 0.2, 1.0, 0.0)
    assert (analog.speed, analog.lead_time) == (0.1, 0.005)


def test_a_process_has_values_by_layer_with_their_units(
    folder: FilePath, refuses: Callable[..., None]
) -> None:
    layers = {"contour,": "contour,layer,", "a,0": "a,CUT,0", "a,60": "a,CUT,60", "b,": "b,MARK,"}
    text = TWO
    for old, new in layers.items():
        text = text.replace(old, new)
    (folder / "layers.csv").write_text(text)
    given = {
        "lead_in": {"length": "5 mm"},
        "switch": {"name": "laser"},
        "by_layer": {
            "MARK": {
                "lead_in": None,
                "switch": {"name": "laser", "value": 0.2},
                "passes": 2,
                "tabs": {"count": 2, "width": "1 mm"},
            },
            "GONE": {"dwell": "1 s"},
        },
    }
    made = job(folder, path={"file": "layers.csv"}, process=given)
    own = made.process.of_layer("MARK")
    assert own.lead_in is None and own.passes == 2 and own.tabs is not None
    assert own.tabs.width == 1e-3 and own.switch is not None and own.switch.value == 0.2
    assert made.process.of_layer("CUT").lead_in is not None
    assert made.objective is not None
    cut, mark = made.objective.contours
    assert cut.path.length == pytest.approx(0.065) and len(mark.events) == 10
    open_speeds = {"process": {"analog": [{"name": "power"}]}, "limits": {"speed": None}}
    refuses(lambda: job(folder, **open_speeds), InvalidInput, "Run taught", "power", "contour a")
    speeds = {"file": "layers.csv", "layers": {x: {"speed": "1 mm/s"} for x in ("CUT", "MARK")}}
    assert job(folder, path=speeds, **open_speeds).process.analog
    assert made.program.notes[-1] == "process.by_layer: no contour is on the layer 'GONE'."


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"process": {"by_layer": {"": {"order": "drawn"}}}}, ("process.by_layer", "order")),
        ({"process": {"by_layer": {"": {"dwell": "1 mm"}}}}, ("process.by_layer", "dwell")),
        ({"process": {"by_layer": {"": {"passes": None}}}}, ("by_layer", "passes")),
        ({"path": {"file": "no.csv"}}, ("There is no file", "no.csv")),
        ({"path": {"file": "two.step"}}, ("two.step", ".dxf")),
        ({"path": {"points": [[0, 0], [1, 1]]}}, ("file, or points",)),
        ({"path": {"names": ["c"]}}, ("'c'", "'a', 'b'")),
        ({"path": {"frame": {"position": [0.3, 0.1, "1 mm"]}}}, ("path.frame", "z = 0")),
        ({"path": {"frame": {"position": [0.3, 0.1, 0], "rpy": [0.1, 0, 0]}}}, ("path.frame",)),
        ({"path": {"orientation": {"axis": [0, 0, -1]}}}, ("path.orientation", "in space")),
        ({"path": {"units": "kg"}}, ("units", "'kg'")),
        ({"process": {"overlap": "-1 mm"}}, ("process.overlap",)),
        ({"process": {"overlap": "1 s"}}, ("process.overlap", "1 s")),
        ({"process": {"lead_in": {"length": 0}}}, ("process", "lead")),
        ({"process": {"lead_in": {"shape": "spiral"}}}, ("process.lead_in.shape",)),
        ({"process": {"approach": "5 mm"}}, ("in the plane",)),
        ({"process": {"from_s": "5 m"}}, ("5 m",)),
        ({"process": {"begin": [0.3, 0.1, 0.0]}}, ("begin",)),
        ({"process": {"events": [{"name": "x", "at": "1 m"}]}}, ("x", "contour a")),
        ({"process": {"speed": 1}}, ("process.speed",)),
    ],
)
def test_refuses_in_one_sentence(
    changes: dict[str, Any], words: tuple[str, ...], folder: FilePath, refuses: Callable[..., None]
) -> None:
    refuses(lambda: job(folder, **changes), InvalidInput, "plate.yaml", *words)


def test_what_is_said_of_files_needs_one(refuses: Callable[..., None]) -> None:
    data = {**JOB, "path": {"points": [[0.3, 0.1], [0.36, 0.1]], "flat": True}}
    refuses(lambda: parse_job(yaml.safe_dump(data)), InvalidInput, "path.flat", "path.file")


def test_space_and_plane(folder: FilePath, refuses: Callable[..., None]) -> None:
    (folder / "deep.ngc").write_text("G21 F600\nG1 X10 Y0 Z1\nG1 X20 Y10 Z0\n")
    deep = {"path": {"file": "deep.ngc"}}
    refuses(lambda: job(folder, **deep), InvalidInput, "deep.ngc has z", "path.flat", "--flat")
    flat = job(folder, path={"file": "deep.ngc", "flat": True})
    assert flat.single_path.dimension == flat.program.dimension == 2
    space = job(folder, **deep, arm="ur5e", corners={"tolerance": "0.2 mm"})
    assert space.single_path.dimension == space.program.dimension == 3
    drawn = job(
        folder,
        path={"orientation": {"axis": [0, 0, -1]}, "frame": {"position": [0.4, 0, 0.1]}},
        arm="ur5e",
    )
    assert isinstance(drawn.path, Program) and drawn.path.dimension == 3
    np.testing.assert_allclose(drawn.path.contours[0].path(0.0), [0.4, 0, 0.1])
    assert drawn.path.contours[0].path.orientation is not None


def test_the_cells_of_the_package_take_a_drawing(folder: FilePath) -> None:
    assert cell_names() == arm_names()
    for name in cell_names():
        found = read_cell(name, folder / "two.csv")
        assert (found.name, found.title.split(" ")[0]) == ("two", "two.csv")
        assert isinstance(found.path, Program)
        assert found.path.dimension == found.arm.dimension
        assert [x.name for x in found.runs] == ["taught"]


def test_a_job_file_is_a_cell_whose_own_path_gives_way(folder: FilePath) -> None:
    own = {"points": [[0.0, 0.0], [1.0, 1.0]], "frame": JOB["path"]["frame"]}
    (folder / "cell.yaml").write_text(yaml.safe_dump({**JOB, "path": own}))
    found = read_cell(folder / "cell.yaml", folder / "plain.csv", path={"scale": 0.5})
    np.testing.assert_allclose(found.single_path(0.0), [0.3, 0.08])
    # A unit that a column has itself is kept, but a scale is one of all lengths.
    assert found.single_path.length == pytest.approx(0.05)
    (folder / "bare.yaml").write_text(
        yaml.safe_dump({key: value for key, value in JOB.items() if key != "path"})
    )
    bare = read_cell(folder / "bare.yaml", folder / "plain.csv", path={"frame": own["frame"]})
    np.testing.assert_allclose(bare.single_path(0.0), [0.3, 0.08])


def test_refuses_what_is_no_cell(folder: FilePath, refuses: Callable[..., None]) -> None:
    drawing = folder / "two.csv"
    refuses(
        lambda: read_cell("lathe", drawing),
        InvalidInput,
        "'lathe'",
        "fr3, panda, pmk3s, ur10e, ur5e",
    )
    refuses(lambda: read_cell("", drawing), InvalidInput, "fr3, panda, pmk3s, ur10e, ur5e")
    refuses(
        lambda: read_cell(folder / "no.yaml", drawing),
        InvalidInput,
        "There is no job file",
        "no.yaml",
    )
    (folder / "list.yaml").write_text(yaml.safe_dump({**JOB, "path": [1, 2]}))
    refuses(lambda: read_cell(folder / "list.yaml", drawing), InvalidInput, "list.yaml", "path")


def test_files_are_looked_for_beside_the_job(
    folder: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "sub").mkdir()
    (folder / "sub" / "job.yaml").write_text(
        yaml.safe_dump({**JOB, "path": {"file": "../two.csv"}})
    )
    monkeypatch.chdir("/")
    found = read_job(folder / "sub" / "job.yaml")
    assert isinstance(found.path, Program)


def test_resuming_a_plain_file_leaves_one_path(folder: FilePath) -> None:
    rest = job(folder, path={"file": "plain.csv"}, process={"from_s": "30 mm"})
    assert rest.single_path.length == pytest.approx(0.07)
    np.testing.assert_allclose(rest.single_path(0.0), [0.33, 0.08])
    assert ac.plan(rest.single_path, rest.arm, rest.runs[0].limits).duration > 0


def test_a_tool_that_follows_contours_does_not_follow_rapids(
    tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    way = "G0 X400 Y-50 Z0\nG1 X450 F3000\nG0 Z20\nG0 Y-40\nG0 Z0\nG1 X400\n"
    (tmp_path / "raster.ngc").write_text(f"G21 G90\n{way}M2\n")
    (tmp_path / "drill.ngc").write_text("G21 G90\nG0 X400 Z20\nG1 Z0 F3000\nM2\n")
    path = {"orientation": {"follow_tangent": {"up": [0, 0, 1]}}}
    program = read_cell("ur5e", tmp_path / "raster.ngc", path=path).path
    assert isinstance(program, Program)
    first, rapid, second = program.moves
    assert rapid.path.orientation is None
    assert first.path.orientation is not None and second.path.orientation is not None
    refuses(
        lambda: read_cell("ur5e", tmp_path / "drill.ngc", path=path),
        InvalidInput,
        "path.orientation, contour line 3",
        "up lies along",
    )


def test_a_layer_of_which_names_leave_nothing_demands_nothing(folder: FilePath) -> None:
    (folder / "layers.csv").write_text(
        "x,y,contour,layer\n0,0,a,A\n0.06,0,a,A\n0,0.03,b,B\n0.06,0.03,b,B\n"
    )
    layers = {"A": {"speed": 0.02}, "B": {"speed": 0.01}}
    found = job(folder, path={"file": "layers.csv", "layers": layers, "names": ["a"]})
    assert found.single_path.speeds.tolist() == [0.02]


def test_what_a_file_says_of_the_tool_goes_before_the_cell(tmp_path):
    file = tmp_path / "seam.csv"
    file.write_text("x,y,z,ax,ay,az\n0,0,0,0,0.1,-1\n50,0,0,0,0.1,-1\n")
    job = read_cell("ur5e", file, path={"units": "mm"})
    axis = job.single_path.orientation(0.0)[:, 2]
    np.testing.assert_allclose(axis, np.array([0, 0.1, -1]) / np.hypot(0.1, 1), atol=1e-12)
    assert isinstance(job.path, ac.Program)
    assert "comes from seam.csv" in job.path.notes[-1]


def test_settings_for_layers_do_not_demand_them(tmp_path, refuses):
    file = tmp_path / "w.csv"
    file.write_text("x,y,layer\n0,0,CUT\n50,0,CUT\n")
    layers = {"CUT": {"speed": 0.02}, "MARK": {}}
    job = read_cell("pmk3s", file, path={"units": "mm", "layers": layers})
    assert isinstance(job.path, ac.Program)
    np.testing.assert_array_equal(ac.prepare(job.path, job.process).contours[0].path.speeds, [0.02])
    assert job.path.notes == ("there is nothing on the layer 'MARK'.",)
    refuses(
        lambda: read_cell("pmk3s", file, path={"units": "mm", "layers": {"MARK": {}}}),
        ac.InvalidInput,
        "has no layer 'MARK'",
    )


@pytest.mark.usefixtures("soon")
def test_jobs_and_cells_that_never_end_or_are_too_large_are_refused(
    folder: FilePath, refuses: Callable[..., None]
) -> None:
    drawing = folder / "two.csv"
    os.mkfifo(folder / "pipe.yaml")
    (folder / "zero.yaml").symlink_to("/dev/zero")
    (folder / "folder.yaml").mkdir()
    with open(folder / "large.yaml", "wb") as file:
        file.truncate(3_000_000_000)
    (folder / "latin.yaml").write_bytes(b"name: \xe9")
    for name, words in (
        ("pipe", "not a regular file"),
        ("zero", "not a regular file"),
        ("folder", "Is a directory"),
        ("large", "3000 MB, more than the 64 MB"),
        ("latin", "not UTF-8"),
        ("nul\0", "cannot be read"),
    ):
        file = folder / f"{name}.yaml"
        refuses(lambda file=file: read_job(file), InvalidInput, "The job file", words)
        refuses(lambda file=file: read_cell(file, drawing), InvalidInput, "The job file", words)


def test_a_job_has_names_that_can_be_printed(
    folder: FilePath, refuses: Callable[..., None]
) -> None:
    for key, name, words in (
        ("name", "x\x1b]52;c;cHduZWQ=\x1b\\", "name of the job has the character U+001B"),
        ("name", "x" * 81, "name of the job has 81 characters, more than 80"),
        ("title", "x\u202e", "title of the job has the character U+202E"),
        ("title", "x" * 201, "title of the job has 201 characters, more than 200"),
        ("process", {"switch": {"name": "a\x07"}}, "process.switch: The name of an event"),
        ("process", {"events": [{"name": "a" * 100_000}]}, "100000 characters, more than 80"),
        ("process", {"events": [{"name": "a", "value": "\x9b"}]}, "value of the event a"),
        ("process", {"off_between": ["\x1b"]}, "process: The name in off_between"),
        ("\x1b]0;x\x07", 1, r"unknown key \x1b]0;x\x07"),
        ("x" * 100_000, 1, "unknown key xxx"),
    ):
        refuses(lambda key=key, name=name: job(folder, **{key: name}), InvalidInput, words)


def test_a_drawing_in_a_cell_may_have_a_name_that_no_job_has(folder: FilePath) -> None:
    for stem in ("d" * 200, "a\u202eb"):
        file = folder / f"{stem}.csv"
        file.write_text(TWO)
        found = read_cell("ur5e", file, path={"frame": {"position": [0.3, 0.08, 0.1]}})
        assert len(found.name) <= 80 and found.name.isprintable()
        assert len(found.title) <= 200 and found.title.isprintable()


def test_a_closed_path_of_points_begins_elsewhere_only_if_there_is_a_process(folder):
    ring = [[0.3, 0.1], [0.36, 0.1], [0.33, 0.14], [0.3, 0.1]]
    points = {**JOB, "path": {"points": ring}}
    found = parse_job(yaml.safe_dump(points))
    np.testing.assert_array_equal(found.single_path(0.0), ring[0])
    moved = parse_job(yaml.safe_dump({**points, "process": {"overlap": "1 mm"}}))
    assert np.linalg.norm(moved.single_path(0.0) - ring[0]) > 0.01


def test_errors_of_one_plain_contour_of_a_file_may_end_when_the_job_says(folder, refuses):
    runs = {"one": {"until": "9 s"}}
    found = job(folder, path={"file": "plain.csv"}, runs=runs)
    assert found.runs[0].until == 9.0
    refuses(
        lambda: job(folder, runs=runs),
        InvalidInput,
        "plate.yaml",
        "until is for a job with a single path",
    )


def test_tools_have_diameters_by_their_numbers(folder: FilePath, refuses: Any) -> None:
    (folder / "part.nc").write_text("F600\nG41 D1 G1 X10\nX20\nM2\n")
    for diameter in ("4 mm", 4e-3):
        found = job(folder, path={"file": "part.nc", "tools": {1: diameter}}).path
        assert isinstance(found, Program)
        y = found.path.vertices[:, 1]
        np.testing.assert_allclose(y[1:] - y[0], 2e-3, atol=1e-12)
    for tools in ({"one": "4 mm"}, {1: "4"}, {-1: 4e-3}):
        refuses(
            lambda tools=tools: job(folder, path={"file": "part.nc", "tools": tools}),
            InvalidInput,
            "tool",
        )


def test_words_of_g_code_are_left_out_by_name(folder: FilePath, refuses: Any) -> None:
    (folder / "part.nc").write_text("T1 M6\nG1 X60 F600\nG55 G0 Y9\nG1 X0\n")
    named = job(folder, path={"file": "part.nc", "unknown": {"skip": ["t", "M06", "G55"]}}).path
    assert isinstance(named, Program)
    assert "M6 (1 time" in named.notes[0] and "the word T (1 time" in named.notes[0]
    stated = job(folder, path={"file": "part.nc", "offsets": "zero"}).path
    assert isinstance(stated, Program)
    assert [x.path.length for x in stated.contours] == pytest.approx([0.06, 0.06])
    for unknown, words in (
        ({"skip": ["X"]}, "names 'X', which cannot be left out"),
        ({"skip": ["M6"]}, "is for G-code"),
    ):
        file = "part.nc" if "X" in unknown["skip"] else "two.csv"
        refuses(
            lambda file=file, unknown=unknown: job(folder, path={"file": file, "unknown": unknown}),
            InvalidInput,
            words,
        )
    refuses(lambda: job(folder, path={"file": "part.nc"}), InvalidInput, "line 3", "offsets: zero")


def test_a_wrong_drawing_is_not_the_fault_of_its_cell(folder: FilePath, refuses) -> None:
    for name, path, words in (
        ("nope.dxf", {}, f"There is no file {folder / 'nope.dxf'}."),
        ("plain.csv", {"units": "mm", "names": ["7"]}, "plain.csv has no contour '7'"),
    ):
        with pytest.raises(InvalidInput) as caught:
            read_cell("ur5e", folder / name, path=path)
        assert str(caught.value).startswith(words)
    # What the cell says of the drawing is the cell's.
    bad = {"frame": {"position": [0.3, 0.2, 0.1]}}
    refuses(
        lambda: read_cell("pmk3s", folder / "plain.csv", path=bad),
        InvalidInput,
        "the cell pmk3s: path.frame lifts",
    )


def test_what_the_process_asks_for_in_vain_is_noted(folder: FilePath) -> None:
    given: dict[str, Any] = {"off_between": ["spindel"], "tabs": {"count": 2, "width": "1 mm"}}
    given |= {"switch": {"name": "laser"}}
    found = job(folder, path={"file": "plain.csv"}, process=given).program.notes
    assert found[-2] == (
        "process.off_between: nothing switches the output 'spindel', so it is not switched off "
        "during rapids either; outputs that are switched: laser."
    )
    assert found[-1] == "process.tabs: no contour is closed, so there are no tabs."
    given |= {"off_between": ["glue", "laser"], "events": [{"name": "glue"}]}
    assert job(folder, process=given).program.notes == ()
