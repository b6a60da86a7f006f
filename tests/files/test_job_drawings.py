"""Drawings in job files and in cells: the program from the file, and refusals."""

import numpy as np
import pytest
import yaml
from tests.files.tables import refusals, values

import armcontour as ac
from armcontour.files import parse_job, read_job
from armcontour.files.job_file import cell_names, read_cell
from armcontour.files.robots.arm_loading import arm_names
from armcontour.jobs import run
from armcontour.program import Program, prepare

TWO = "contour,x [mm],y [mm]\na,0,0\na,60,0\nb,0,30\nb,60,30\nb,60,60\nb,0,30\n"
PLAIN = "x [mm],y [mm]\n0,0\n60,0\n60,40\n"
JOB = yaml.safe_load("""
name: plate
arm: pmk3s
path: {file: two.csv, frame: {position: [300 mm, 80 mm, 0]}}
limits: {speed: 50 mm/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
runs: {compensated: {timing: {method: optimal}, compensation: {method: inverse}}}
""")
POINTS = {**JOB, "path": {"points": [[0.3, 0.1], [0.36, 0.1]]}}


PLAIN_FILE = {"file": "plain.csv"}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "two.csv").write_text(TWO)
    (tmp_path / "plain.csv").write_text(PLAIN)
    return tmp_path


def job(folder, text="{}", **changes):
    changes |= yaml.safe_load(text)
    path = {**JOB["path"], **changes.pop("path", {})}
    text = yaml.safe_dump({**JOB, "path": path, **changes})
    return parse_job(text, source="plate.yaml", folder=folder)


def test_a_file_becomes_a_program_in_its_frame(folder):
    program = job(folder).path
    assert isinstance(program, Program) and [x.name for x in program.contours] == ["a", "b"]
    np.testing.assert_allclose(program.contours[0].path.vertices, [[0.3, 0.08], [0.36, 0.08]])
    turned = job(folder, "path: {frame: {position: [0.3, 0.1, 0], rpy: [0, 0, 90 deg]}}").path
    np.testing.assert_allclose(turned.contours[0].path(0.06), [0.3, 0.16], atol=1e-15)
    scaled = job(folder, "path: {scale: 0.5, names: [b]}").path
    assert isinstance(scaled, Program) and len(scaled.contours) == 1
    np.testing.assert_allclose(scaled.length, 0.045 + 0.5 * np.hypot(0.06, 0.03), atol=1e-15)


def test_a_file_of_one_plain_contour_is_a_job_of_one_path(folder):
    plain = job(folder, path=PLAIN_FILE, runs={"one": {"end_time": "9 s"}})
    assert plain.program.path.length == pytest.approx(0.1) and plain.runs[0].end_time == 9.0
    rest = job(folder, "process: {resume_at: 30 mm}", path=PLAIN_FILE)
    single = prepare(rest.program, rest.process).single_path
    assert single.length == pytest.approx(0.07)
    np.testing.assert_allclose(single(0.0), [0.33, 0.08])
    assert ac.plan(single, rest.arm, rest.runs[0].limits).duration > 0
    assert job(folder, "process: {lead_out: {}}", path=PLAIN_FILE).process.automatic
    with_leads = job(folder, "process: {lead_in: {length: 5 mm}}", path=PLAIN_FILE)
    switched = parse_job(yaml.safe_dump({**POINTS, "process": {"switch": {"name": "laser"}}}))
    for x in (with_leads, switched):
        assert prepare(x.program, x.process).single_path is None


def test_a_drawing_is_repeated_in_its_own_coordinates(folder):
    repeat = "{columns: 2, rows: 2, column_spacing: 70 mm, row_spacing: 80 mm}"
    turned = "{position: [0.3, 0.1, 0], rpy: [0, 0, 90 deg]}"
    program = job(folder, f"path: {{repeat: {repeat}, scale: 0.5, frame: {turned}}}").program
    order = [f"{x} {y}" for y in ("[1,1]", "[1,2]", "[2,2]", "[2,1]") for x in "ab"]
    assert [x.name for x in program.contours] == order
    # 70 mm along the drawing's x, which is y here, and 80 mm along its y.
    np.testing.assert_allclose(program.contours[4].path(0.0), [0.22, 0.17], atol=1e-12)
    for name, names in (("a [2,1]", ["a [2,1]"]), ("b", [x for x in order if x[0] == "b"])):
        read_program = job(folder, f"path: {{repeat: {repeat}, names: ['{name}']}}").program
        assert [x.name for x in read_program.contours] == names
    words = "no contour 'c [1,1]' ... 'a [1,1]'"
    named = f"path: {{repeat: {repeat}, names: ['c [1,1]']}}"
    table = [("path: {repeat: {columns: 2}}", "path.repeat ... column_sp"), (named, words)]
    refusals(lambda x: job(folder, x), table)


PROCESS = """
begin: [300 mm, 110 mm] => {begin: [0.3, 0.11]}
overlap: 2 mm => {overlap: 0.002}
lead_in: {length: 5 mm, shape: arc, side: right} => {lead_in.length: 0.005, lead_in.side: right}
lead_in: {shape: arc, active: true} => {lead_in.shape: arc, lead_in.active: true}
lead_out: {length: auto} => {lead_out.length: null, lead_out.active: false}
{pierce: {time: 300 ms}, switch: {name: x}} => {pierce.time: 0.3}
switch: {name: x, on_lead: 20 ms, off_lead: 5 ms} => {switch.on_lead: 0.02, switch.off_lead: 0.005}
events: [{name: gas, value: 2.5, at: 1 mm}] => {events.gas.value: 2.5, events.gas.s: 0.001}
events: [{name: gas, lead_time: -10 ms}] => {events.gas.lead_time: -0.01}
analog: [{name: p, rest: 20 %}] => {analog.p.rest: 0.2, analog.p.full: 1.0, analog.p.off: 0.0}
analog: [{name: p, speed: 100 mm/s}] => {analog.p.speed: 0.1}
analog: [{name: p, lead_time: 5 ms}] => {analog.p.lead_time: 0.005}
resume_at: 12 mm => {resume_at: 0.012}
{kerf: 0.2 mm, kerf_side: left} => {kerf: 0.0002, kerf_side: left}
"""
LAYERS = """
lead_in: {length: 5 mm}
switch: {name: laser}
by_layer:
  MARK: {lead_in: null, switch: {name: laser, value: 0.2}, passes: 2, tabs: {count: 2, width: 1 mm}}
  GONE: {dwell: 1 s}
"""


def test_a_process_has_values_with_units_for_each_layer(folder):
    values(lambda x: job(folder, process=yaml.safe_load(x)).process, PROCESS)
    pierced = "{pierce: {time: 1, height: 3 mm}, switch: {name: x}, lead_out: {}}"
    refusals(lambda x: job(folder, process=yaml.safe_load(x)), [(pierced, "in the plane")])
    file = {"file": str(folder / "two.csv"), "orientation": {"axis": [0, 0, -1]}}
    in_space = {**JOB, "arm": "ur5e", "path": file, "process": yaml.safe_load(pierced)}
    assert parse_job(yaml.safe_dump(in_space)).process.pierce.height == 0.003
    layers = {"contour,": "contour,layer,", "a,0": "a,CUT,0", "a,60": "a,CUT,60", "b,": "b,MARK,"}
    text = TWO
    for old, new in layers.items():
        text = text.replace(old, new)
    (folder / "layers.csv").write_text(text)
    made = job(folder, path={"file": "layers.csv"}, process=yaml.safe_load(LAYERS))
    at_cut, at_mark = (made.process.of_contour(x) for x in made.program.contours)
    assert at_mark.lead_in is None and at_mark.passes == 2
    assert at_mark.tabs.width == 1e-3 and at_mark.switch.value == 0.2
    assert at_cut.lead_in is not None
    cut, mark = prepare(made.program, made.process).contours
    assert cut.path.length == pytest.approx(0.065) and len(mark.events) == 10
    note = "process.by_layer has the layer 'GONE', but no contour is on this layer."
    assert made.program.notes[-1] == note
    open_speeds = "{process: {analog: [{name: power}]}, limits: {speed: inf}}"
    refusals(
        lambda x: job(folder, x), [(open_speeds, "Run compensated ... power ... (a) has none")]
    )
    speeds = {"file": "layers.csv", "layers": {x: {"speed": "1 mm/s"} for x in ("CUT", "MARK")}}
    assert job(folder, open_speeds, path=speeds).process.analog


OWN = """
speed: 20 mm/s
tolerance: 0
lead_in: null
tabs: {count: 1, width: 2 mm}
"""


@pytest.mark.parametrize("key", ["b", 2, "2"])
def test_a_contour_can_have_its_own_process_values(folder, key):
    """Values of the contour win over those of its layer and of the file; others stay the same."""
    rows = TWO.replace("[mm]\n", "[mm],layer,speed\n", 1).replace("0\n", "0,CUT,0.04\n")
    (folder / "layers.csv").write_text(rows)
    by_layer = {"CUT": {"overlap": "3 mm", "tabs": {"count": 2, "width": "1 mm"}}}
    shared = {"lead_in": {"length": "5 mm"}, "switch": {"name": "laser"}, "by_layer": by_layer}
    own = yaml.safe_load(OWN)
    drawn = {"file": "layers.csv", "layers": {"CUT": {"tolerance": "0.1 mm"}}}
    plain, changed = (
        job(folder, path=drawn | {"contours": x}, process=shared) for x in ({}, {key: own})
    )
    (a, b), (same, mine) = (prepare(x.program, x.process).contours for x in (plain, changed))
    for name in ("starts", "ends", "speeds", "tolerances"):
        np.testing.assert_array_equal(*(getattr(x.path.segments, name) for x in (a, same)))
    assert same.events == a.events and same.work == a.work
    assert set(b.path.speeds[1:]) == {0.04} and set(b.path.tolerances[1:]) == {1e-4}
    assert set(mine.path.speeds) == {0.02} and set(mine.path.tolerances) == {0.0}
    # Its own tabs and no lead-in, but the overlap of its layer.
    assert mine.at_work[0] == 0.0 and b.at_work[0] == pytest.approx(5e-3)
    assert mine.path.length == pytest.approx(b.path.length - 5e-3)
    assert len(b.events) == 6 and len(mine.events) == 4
    assert mine.events[2].s - mine.events[1].s == pytest.approx(2e-3)

    def durations(one):
        trajectory = run(one, simulate=False).runs["compensated"].trajectory
        return np.ptp([x.t for x in trajectory.contour_spans], 1)

    before = durations(plain)
    after = durations(changed)
    assert after[0] == before[0] and after[1] > mine.path.length / 0.02 > before[1]


def test_contours_run_in_the_order_of_the_job(folder):
    later = job(folder, path={"contours": {"a": {"order": 1}}})
    assert [x.name for x in prepare(later.program, later.process).contours] == ["b", "a"]
    repeat = {"columns": 2, "column_spacing": "70 mm"}
    own = {"b [1,1]": {"order": -1}, 3: {"order": 2}}
    copies = job(folder, path={"repeat": repeat, "contours": own}, process={"order": "nearest"})
    assert [x.number for x in copies.program.contours] == [1, 2, 3, 4]
    order = [x.name for x in prepare(copies.program, copies.process).contours]
    assert order[0] == "b [1,1]" and order[-1] == "a [1,2]" and len(order) == 4
    (folder / "two.ngc").write_text("G21 G1 F900 X10\nG0 X20\nG1 X30\n")
    moved = job(folder, path={"file": "two.ngc", "contours": {2: {"order": -1}}})
    refusals(lambda x: prepare(moved.program, moved.process), [("", "only ... rapids")])


CONTOURS = """
{c: {speed: 1 mm/s}} => path.contours.c ... two.csv ... numbers 1 to 2 ... 'a', 'b' ... (line 10)
{3: {speed: 1 mm/s}} => path.contours.3 ... numbers 1 to 2 ... (line 10)
{a: {}, 1: {speed: 1 mm/s}} => path.contours.1 is the same contour as a ... (line 11)
{a: {sped: 1}} => path.contours.a.sped ... speed
{a: {speed: 1 kg}} => path.contours.a.speed ... (line 11)
{b: {pierce: {time: 1 s}}} => path.contours.b ... switch ... (line 10)
"""


def test_names_of_contours_are_checked(folder):
    def of_text(contours):
        data = {**JOB, "path": {"contours": yaml.safe_load(contours), **JOB["path"]}}
        return parse_job(yaml.safe_dump(data), source="plate.yaml", folder=folder)

    refusals(of_text, CONTOURS)
    left_out = job(folder, path={"names": ["a"], "contours": {"b": {"speed": "1 mm/s"}}})
    assert "path.contours.b has no effect" in left_out.program.notes[-1]
    points = parse_job(
        yaml.safe_dump({**POINTS, "path": {**POINTS["path"], "contours": {1: {"speed": 0.01}}}})
    )
    assert set(points.program.contours[0].path.speeds) == {0.01}


BAD = r"""
process: {by_layer: {"": {order: drawn}}} => process.by_layer ... order
process: {by_layer: {"": {passes: null}}} => by_layer ... passes
path: {points: [[0, 0], [1, 1]]} => exactly one of file, points
path: {frame: {position: [0.3, 0.1, 1 mm]}} => path.frame ... z = 0
path: {frame: {position: [0.3, 0.1, 0], rpy: [0.1, 0, 0]}} => path.frame
path: {orientation: {axis: [0, 0, -1]}} => path.orientation ... in space
process: {approach: 5 mm} => in the plane
runs: {one: {end_time: 9 s}} => end_time requires a job with a single path
name: "x\e]52;c;cHduZWQ=\e\\" => name of a job has the character U+001B
process: {switch: {name: "a\a"}} => process.switch.name: has the character U+0007
"""


def test_invalid_jobs_of_drawings_are_refused_in_one_sentence(folder):
    refusals(lambda x: job(folder, x), BAD, "plate.yaml")
    long = [
        ({"name": "x" * 81}, "name of a job has 81 characters, more than 80"),
        ({"title": "x" * 201}, "title of a job has 201 characters, more than 200"),
    ]
    refusals(lambda x: job(folder, **x), long, "plate.yaml")
    # Options for files require a file.
    points = POINTS["path"]
    repeat = {"columns": 2, "column_spacing": 1}
    table = [(points | {"ignore_z": True}, "path.ignore_z ... path.file"),
             (points | {"repeat": repeat}, "path.repeat ... path.file")]  # fmt: skip
    refusals(lambda path: parse_job(yaml.safe_dump({**JOB, "path": path})), table)


def test_drawings_are_read_for_arms_in_space_and_in_the_plane(folder):
    (folder / "deep.ngc").write_text("G21 F600\nG1 X10 Y0 Z1\nG1 X20 Y10 Z0\n")
    words = "deep.ngc has z coordinates ... path.ignore_z ... --ignore-z"
    refusals(lambda x: job(folder, x), [("path: {file: deep.ngc}", words)])
    for text, dimension in (
        ("path: {file: deep.ngc, ignore_z: true}", 2),
        ("{path: {file: deep.ngc}, arm: ur5e, corners: {tolerance: 0.2 mm}}", 3),
    ):
        job_in_space = job(folder, text)
        assert job_in_space.program.path.dimension == dimension
    path = {"orientation": {"axis": [0, 0, -1]}, "frame": {"position": [0.4, 0, 0.1]}}
    drawn = job(folder, path=path, arm="ur5e").path
    assert isinstance(drawn, Program) and drawn.dimension == 3
    np.testing.assert_allclose(drawn.contours[0].path(0.0), [0.4, 0, 0.1])
    assert drawn.contours[0].path.orientation is not None


def test_a_cell_and_a_drawing_are_a_job(folder):
    assert set(cell_names()) == {*arm_names(), "ur10e_positioner"}
    for name in cell_names():
        cell_job = read_cell(name, folder / "two.csv")
        assert (cell_job.name, cell_job.title.split(" ")[0]) == ("two", "two.csv")
        assert isinstance(cell_job.path, Program)
        assert cell_job.path.dimension == cell_job.arm.dimension
        assert [x.name for x in cell_job.runs] == ["compensated"]
    # A job file is a cell whose own path gives way.
    frame = JOB["path"]["frame"]
    path_keys = {"points": [[0.0, 0.0], [1.0, 1.0]], "frame": frame}
    bare = {key: value for key, value in JOB.items() if key != "path"}
    for data, path, length in (
        # A unit that a column has itself is kept, but a scale is one of all lengths.
        ({**JOB, "path": path_keys}, {("path", "scale"): 0.5}, 0.05),
        (bare, {("path", "frame"): frame}, 0.1),
    ):
        (folder / "cell.yaml").write_text(yaml.safe_dump(data))
        cell_job = read_cell(folder / "cell.yaml", folder / "plain.csv", patch=path).program.path
        np.testing.assert_allclose(cell_job(0.0), [0.3, 0.08])
        assert cell_job.length == pytest.approx(length)


def test_invalid_cells_are_refused(folder):
    (folder / "list.yaml").write_text(yaml.safe_dump({**JOB, "path": [1, 2]}))
    table = [
        ("", "fr3, panda, pmk3s, ur10e, ur10e_positioner, ur5e"),
        (folder / "no.yaml", "There is no job file ... no.yaml"),
        (folder / "list.yaml", "list.yaml ... path"),
    ]
    refusals(lambda cell: read_cell(cell, folder / "two.csv"), table)


def test_file_names_are_relative_to_the_folder_of_the_job(folder, monkeypatch):
    (folder / "sub").mkdir()
    data = {**JOB, "path": {"file": "../two.csv"}}
    (folder / "sub" / "job.yaml").write_text(yaml.safe_dump(data))
    monkeypatch.chdir("/")
    parsed = read_job(folder / "sub" / "job.yaml")
    assert isinstance(parsed.path, Program)


def test_settings_of_layers_that_do_not_exist_cause_a_note(tmp_path, folder):
    file = tmp_path / "w.csv"
    file.write_text("x,y,layer\n0,0,CUT\n50,0,CUT\n")

    def read(layers):
        keys = {("path", "units"): "mm", ("path", "layers"): layers}
        return read_cell("pmk3s", file, patch=keys)

    processes = read({"CUT": {"speed": 0.02}, "MARK": {}})
    speeds = ac.prepare(processes.path, processes.process).contours[0].path.speeds
    np.testing.assert_array_equal(speeds, [0.02])
    assert processes.path.notes == ("the layer 'MARK' has no contour.",)
    refusals(read, [({"MARK": {}}, "has no layer 'MARK'")])
    # A layer of which names leave nothing demands nothing.
    text = "x,y,contour,layer\n0,0,a,A\n0.06,0,a,A\n0,0.03,b,B\n0.06,0.03,b,B\n"
    (folder / "layers.csv").write_text(text)
    layers = "{A: {speed: 0.02}, B: {speed: 0.01}}"
    processes = job(folder, f"path: {{file: layers.csv, layers: {layers}, names: [a]}}")
    assert prepare(processes.program, processes.process).path.speeds.tolist() == [0.02]
