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

# Two contours, of which the second is closed.
TWO_CONTOURS_CSV = "contour,x [mm],y [mm]\na,0,0\na,60,0\nb,0,30\nb,60,30\nb,60,60\nb,0,30\n"
ONE_CONTOUR_CSV = "x [mm],y [mm]\n0,0\n60,0\n60,40\n"
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
    """Folder with the drawings `two.csv` and `plain.csv`."""
    (tmp_path / "two.csv").write_text(TWO_CONTOURS_CSV)
    (tmp_path / "plain.csv").write_text(ONE_CONTOUR_CSV)
    return tmp_path


def job(folder, text="{}", **changes):
    """Return the job JOB with changed keys, which are YAML text or Python data.

    Keys of `path` are added to those of JOB; other keys replace them.
    """
    changes |= yaml.safe_load(text)
    path = {**JOB["path"], **changes.pop("path", {})}
    text = yaml.safe_dump({**JOB, "path": path, **changes})
    return parse_job(text, source="plate.yaml", folder=folder)


def test_each_contour_of_a_file_becomes_a_contour_of_the_program(folder):
    program = job(folder).path
    assert isinstance(program, Program)
    assert [x.name for x in program.contours] == ["a", "b"]
    np.testing.assert_allclose(program.contours[0].path.vertices, [[0.3, 0.08], [0.36, 0.08]])


def test_the_frame_of_a_job_moves_and_rotates_the_drawing(folder):
    turned = job(folder, "path: {frame: {position: [0.3, 0.1, 0], rpy: [0, 0, 90 deg]}}").path
    np.testing.assert_allclose(turned.contours[0].path(0.06), [0.3, 0.16], atol=1e-15)


def test_a_job_scales_a_drawing_and_selects_contours(folder):
    program = job(folder, "path: {scale: 0.5, names: [b]}").path
    assert isinstance(program, Program) and len(program.contours) == 1
    # Half of 60, 30 and hypot(60, 30) mm
    np.testing.assert_allclose(program.length, 0.045 + 0.5 * np.hypot(0.06, 0.03), atol=1e-15)


def test_a_job_of_one_contour_accepts_an_end_time(folder):
    plain = job(folder, path=PLAIN_FILE, runs={"one": {"end_time": "9 s"}})
    assert plain.program.path.length == pytest.approx(0.1)
    assert plain.runs[0].end_time == 9.0


def test_a_resumed_contour_without_leads_is_planned_as_a_path(folder):
    rest = job(folder, "process: {resume_at: 30 mm}", path=PLAIN_FILE)
    path = prepare(rest.program, rest.process).single_path
    assert path.length == pytest.approx(0.07)
    np.testing.assert_allclose(path(0.0), [0.33, 0.08])
    assert ac.plan(path, rest.arm, rest.runs[0].limits).duration > 0


def test_a_lead_without_a_length_is_automatic(folder):
    assert job(folder, "process: {lead_out: {}}", path=PLAIN_FILE).process.automatic


def test_a_contour_with_leads_or_a_switch_is_not_a_single_path(folder):
    with_leads = job(folder, "process: {lead_in: {length: 5 mm}}", path=PLAIN_FILE)
    switched = parse_job(yaml.safe_dump({**POINTS, "process": {"switch": {"name": "laser"}}}))
    for one_job in (with_leads, switched):
        assert prepare(one_job.program, one_job.process).single_path is None


REPEAT = "{columns: 2, rows: 2, column_spacing: 70 mm, row_spacing: 80 mm}"
# Copies are drawn row by row, in alternating directions.
COPIES = ["a [1,1]", "b [1,1]", "a [1,2]", "b [1,2]", "a [2,2]", "b [2,2]", "a [2,1]", "b [2,1]"]


def test_a_drawing_is_repeated_in_its_own_coordinates(folder):
    turned = "{position: [0.3, 0.1, 0], rpy: [0, 0, 90 deg]}"
    program = job(folder, f"path: {{repeat: {REPEAT}, scale: 0.5, frame: {turned}}}").program
    assert [x.name for x in program.contours] == COPIES
    # The copy [2,2] is 70 mm along the drawing's x, which is y of the job, and 80 mm along its y.
    np.testing.assert_allclose(program.contours[4].path(0.0), [0.22, 0.17], atol=1e-12)


def test_names_select_one_copy_or_all_copies_of_a_contour(folder):
    def selected(name):
        program = job(folder, f"path: {{repeat: {REPEAT}, names: ['{name}']}}").program
        return [x.name for x in program.contours]

    assert selected("a [2,1]") == ["a [2,1]"]
    assert selected("b") == [x for x in COPIES if x.startswith("b")]


def test_incomplete_repetitions_and_unknown_copies_are_refused(folder):
    unknown = f"path: {{repeat: {REPEAT}, names: ['c [1,1]']}}"
    table = [
        ("path: {repeat: {columns: 2}}", "path.repeat ... column_sp"),
        (unknown, "no contour 'c [1,1]' ... 'a [1,1]'"),
    ]
    refusals(lambda x: job(folder, x), table)


# Values of `process` => values of the fields of `Process`; `a.b` is the field b of the field a.
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
# Process values, some of which are replaced on the layer MARK. The layer GONE has no contour.
LAYERS = """
lead_in: {length: 5 mm}
switch: {name: laser}
by_layer:
  MARK: {lead_in: null, switch: {name: laser, value: 0.2}, passes: 2, tabs: {count: 2, width: 1 mm}}
  GONE: {dwell: 1 s}
"""


def test_process_values_are_converted_to_si(folder):
    values(lambda x: job(folder, process=yaml.safe_load(x)).process, PROCESS)


def test_a_pierce_height_requires_a_job_in_space(folder):
    process = "{pierce: {time: 1, height: 3 mm}, switch: {name: x}, lead_out: {}}"
    refusals(lambda x: job(folder, process=yaml.safe_load(x)), [(process, "in the plane")])
    file = {"file": str(folder / "two.csv"), "orientation": {"axis": [0, 0, -1]}}
    in_space = {**JOB, "arm": "ur5e", "path": file, "process": yaml.safe_load(process)}
    assert parse_job(yaml.safe_dump(in_space)).process.pierce.height == 0.003


@pytest.fixture
def layers_file(folder):
    """Name of a drawing with the contour a on the layer CUT, and b on the layer MARK."""
    layers = {"contour,": "contour,layer,", "a,0": "a,CUT,0", "a,60": "a,CUT,60", "b,": "b,MARK,"}
    text = TWO_CONTOURS_CSV
    for old, new in layers.items():
        text = text.replace(old, new)
    (folder / "layers.csv").write_text(text)
    return "layers.csv"


@pytest.fixture
def layered_job(folder, layers_file):
    """A job with process values for the layers MARK and GONE."""
    return job(folder, path={"file": layers_file}, process=yaml.safe_load(LAYERS))


def test_values_of_a_layer_replace_those_of_the_process(layered_job):
    at_cut, at_mark = (layered_job.process.of_contour(x) for x in layered_job.program.contours)
    assert at_cut.lead_in is not None
    assert at_mark.lead_in is None and at_mark.passes == 2
    assert at_mark.tabs.width == 1e-3 and at_mark.switch.value == 0.2


def test_contours_are_prepared_with_the_values_of_their_layers(layered_job):
    cut, mark = prepare(layered_job.program, layered_job.process).contours
    # 60 mm with a lead of 5 mm
    assert cut.path.length == pytest.approx(0.065)
    # Switching on and off, and twice for each of two tabs in each of two passes
    assert len(mark.events) == 10


def test_process_values_of_a_layer_without_contours_cause_a_note(layered_job):
    note = "process.by_layer has the layer 'GONE', but no contour is on this layer."
    assert layered_job.program.notes[-1] == note


def test_an_analog_output_requires_a_speed_of_every_contour(folder, layers_file):
    no_speed_limit = "{process: {analog: [{name: power}]}, limits: {speed: inf}}"
    words = "Run compensated ... power ... (a) has none"
    refusals(lambda x: job(folder, x), [(no_speed_limit, words)])
    layers = {"CUT": {"speed": "1 mm/s"}, "MARK": {"speed": "1 mm/s"}}
    with_speeds = {"file": layers_file, "layers": layers}
    assert job(folder, no_speed_limit, path=with_speeds).process.analog


# Keys of one contour.
OWN = """
speed: 20 mm/s
tolerance: 0
lead_in: null
tabs: {count: 1, width: 2 mm}
"""


@pytest.fixture(params=["b", 2, "2"])
def plain_and_changed(folder, request):
    """Two equal jobs, in the second of which contour b has the keys OWN, by name or number."""
    with_heading = TWO_CONTOURS_CSV.replace("[mm]\n", "[mm],layer,speed\n", 1)
    (folder / "layers.csv").write_text(with_heading.replace("0\n", "0,CUT,0.04\n"))
    by_layer = {"CUT": {"overlap": "3 mm", "tabs": {"count": 2, "width": "1 mm"}}}
    process = {"lead_in": {"length": "5 mm"}, "switch": {"name": "laser"}, "by_layer": by_layer}
    path = {"file": "layers.csv", "layers": {"CUT": {"tolerance": "0.1 mm"}}}
    plain = job(folder, path=path, process=process)
    own = {request.param: yaml.safe_load(OWN)}
    return plain, job(folder, path=path | {"contours": own}, process=process)


def prepared_contours(one_job):
    return prepare(one_job.program, one_job.process).contours


def test_keys_of_one_contour_do_not_change_another_contour(plain_and_changed):
    before, after = (prepared_contours(x)[0] for x in plain_and_changed)
    for name in ("starts", "ends", "speeds", "tolerances"):
        values_before, values_after = (getattr(x.path.segments, name) for x in (before, after))
        np.testing.assert_array_equal(values_after, values_before)
    assert after.events == before.events and after.work == before.work


def test_speed_and_tolerance_of_a_contour_replace_those_of_file_and_layer(plain_and_changed):
    before, after = (prepared_contours(x)[1] for x in plain_and_changed)
    # Segment 0 is the lead-in, which has no values of the file.
    assert set(before.path.speeds[1:]) == {0.04}
    assert set(before.path.tolerances[1:]) == {1e-4}
    assert set(after.path.speeds) == {0.02}
    assert set(after.path.tolerances) == {0.0}


def test_a_contour_can_have_its_own_tabs_and_no_lead_in(plain_and_changed):
    """It keeps the overlap of its layer, which it does not replace."""
    before, after = (prepared_contours(x)[1] for x in plain_and_changed)
    assert before.at_work[0] == pytest.approx(5e-3)
    assert after.at_work[0] == 0.0
    assert after.path.length == pytest.approx(before.path.length - 5e-3)
    # Switching on and off, and twice for each tab
    assert len(before.events) == 6
    assert len(after.events) == 4
    assert after.events[2].s - after.events[1].s == pytest.approx(2e-3)


def test_the_speed_of_a_contour_changes_only_its_own_duration(plain_and_changed):
    def durations(one_job):
        trajectory = run(one_job, simulate=False).runs["compensated"].trajectory
        return np.ptp([x.t for x in trajectory.contour_spans], 1)

    plain, changed = plain_and_changed
    before = durations(plain)
    after = durations(changed)
    assert after[0] == before[0]
    assert after[1] > prepared_contours(changed)[1].path.length / 0.02 > before[1]


def test_contours_run_in_the_order_of_the_job(folder):
    """The default order is 0, so order 1 is last."""
    later = job(folder, path={"contours": {"a": {"order": 1}}})
    assert [x.name for x in prepare(later.program, later.process).contours] == ["b", "a"]


def test_the_order_of_a_contour_has_priority_over_the_order_of_the_process(folder):
    repeat = {"columns": 2, "column_spacing": "70 mm"}
    # Contour 3 is the contour a of the second copy.
    own = {"b [1,1]": {"order": -1}, 3: {"order": 2}}
    copies = job(folder, path={"repeat": repeat, "contours": own}, process={"order": "nearest"})
    assert [x.number for x in copies.program.contours] == [1, 2, 3, 4]
    order = [x.name for x in prepare(copies.program, copies.process).contours]
    assert order[0] == "b [1,1]" and order[-1] == "a [1,2]" and len(order) == 4


def test_an_order_is_refused_for_a_program_with_rapids(folder):
    (folder / "two.ngc").write_text("G21 G1 F900 X10\nG0 X20\nG1 X30\n")
    moved = job(folder, path={"file": "two.ngc", "contours": {2: {"order": -1}}})
    refusals(lambda x: prepare(moved.program, moved.process), [("", "only ... rapids")])


# Values of `path.contours` => words of the message.
CONTOURS = """
{c: {speed: 1 mm/s}} => path.contours.c ... two.csv ... numbers 1 to 2 ... 'a', 'b' ... (line 10)
{3: {speed: 1 mm/s}} => path.contours.3 ... numbers 1 to 2 ... (line 10)
{a: {}, 1: {speed: 1 mm/s}} => path.contours.1 is the same contour as a ... (line 11)
{a: {sped: 1}} => path.contours.a.sped ... speed
{a: {speed: 1 kg}} => path.contours.a.speed ... (line 11)
{b: {pierce: {time: 1 s}}} => path.contours.b ... switch ... (line 10)
"""


def test_wrong_keys_of_contours_are_refused(folder):
    def read_contours(contours):
        data = {**JOB, "path": {"contours": yaml.safe_load(contours), **JOB["path"]}}
        return parse_job(yaml.safe_dump(data), source="plate.yaml", folder=folder)

    refusals(read_contours, CONTOURS)


def test_keys_of_a_contour_that_is_not_read_cause_a_note(folder):
    left_out = job(folder, path={"names": ["a"], "contours": {"b": {"speed": "1 mm/s"}}})
    assert "path.contours.b has no effect" in left_out.program.notes[-1]


def test_a_path_of_points_is_contour_1():
    path = {**POINTS["path"], "contours": {1: {"speed": 0.01}}}
    points = parse_job(yaml.safe_dump({**POINTS, "path": path}))
    assert set(points.program.contours[0].path.speeds) == {0.01}


# Keys of a job => words of the message.
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


def test_invalid_keys_of_jobs_with_drawings_are_refused(folder):
    refusals(lambda x: job(folder, x), BAD, "plate.yaml")


def test_long_names_and_titles_are_refused(folder):
    table = [
        ({"name": "x" * 81}, "name of a job has 81 characters, more than 80"),
        ({"title": "x" * 201}, "title of a job has 201 characters, more than 200"),
    ]
    refusals(lambda x: job(folder, **x), table, "plate.yaml")


def test_options_of_files_are_refused_for_points():
    points = POINTS["path"]
    repeat = {"columns": 2, "column_spacing": 1}
    table = [
        (points | {"ignore_z": True}, "path.ignore_z ... path.file"),
        (points | {"repeat": repeat}, "path.repeat ... path.file"),
    ]
    refusals(lambda path: parse_job(yaml.safe_dump({**JOB, "path": path})), table)


@pytest.fixture
def deep(folder):
    """Name of a drawing with z coordinates."""
    (folder / "deep.ngc").write_text("G21 F600\nG1 X10 Y0 Z1\nG1 X20 Y10 Z0\n")
    return "deep.ngc"


def test_z_coordinates_are_refused_for_an_arm_in_the_plane(folder, deep):
    words = "deep.ngc has z coordinates ... path.ignore_z ... --ignore-z"
    refusals(lambda x: job(folder, x), [(f"path: {{file: {deep}}}", words)])


@pytest.mark.parametrize(
    ("keys", "dimension"),
    [
        ("path: {file: deep.ngc, ignore_z: true}", 2),
        ("{path: {file: deep.ngc}, arm: ur5e, corners: {tolerance: 0.2 mm}}", 3),
    ],
)
def test_z_coordinates_are_ignored_or_read(folder, deep, keys, dimension):
    assert job(folder, keys).program.path.dimension == dimension


def test_a_drawing_in_the_plane_is_placed_in_space(folder):
    path = {"orientation": {"axis": [0, 0, -1]}, "frame": {"position": [0.4, 0, 0.1]}}
    program = job(folder, path=path, arm="ur5e").path
    assert isinstance(program, Program) and program.dimension == 3
    np.testing.assert_allclose(program.contours[0].path(0.0), [0.4, 0, 0.1])
    assert program.contours[0].path.orientation is not None


def test_every_arm_and_a_positioner_have_a_built_in_cell():
    assert set(cell_names()) == {*arm_names(), "ur10e_positioner"}


@pytest.mark.parametrize("name", cell_names())
def test_a_cell_and_a_drawing_are_a_job(folder, name):
    cell_job = read_cell(name, folder / "two.csv")
    assert (cell_job.name, cell_job.title.split(" ")[0]) == ("two", "two.csv")
    assert isinstance(cell_job.path, Program)
    assert cell_job.path.dimension == cell_job.arm.dimension
    assert [x.name for x in cell_job.runs] == ["compensated"]


def path_with_cell(folder, data, patch):
    """Return the path of `plain.csv` with a cell of these keys and a patch."""
    (folder / "cell.yaml").write_text(yaml.safe_dump(data))
    return read_cell(folder / "cell.yaml", folder / "plain.csv", patch=patch).program.path


def test_a_drawing_replaces_the_path_of_a_job_that_is_used_as_a_cell(folder):
    path_keys = {"points": [[0.0, 0.0], [1.0, 1.0]], "frame": JOB["path"]["frame"]}
    path = path_with_cell(folder, {**JOB, "path": path_keys}, {("path", "scale"): 0.5})
    np.testing.assert_allclose(path(0.0), [0.3, 0.08])
    # The columns keep their own unit, but the scale applies to all lengths.
    assert path.length == pytest.approx(0.05)


def test_a_cell_without_a_path_gets_its_frame_from_the_options(folder):
    without_path = {key: value for key, value in JOB.items() if key != "path"}
    path = path_with_cell(folder, without_path, {("path", "frame"): JOB["path"]["frame"]})
    np.testing.assert_allclose(path(0.0), [0.3, 0.08])
    assert path.length == pytest.approx(0.1)


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


def test_speeds_of_layers_that_do_not_exist_cause_a_note(tmp_path):
    file = tmp_path / "w.csv"
    file.write_text("x,y,layer\n0,0,CUT\n50,0,CUT\n")

    def read(layers):
        keys = {("path", "units"): "mm", ("path", "layers"): layers}
        return read_cell("pmk3s", file, patch=keys)

    cell_job = read({"CUT": {"speed": 0.02}, "MARK": {}})
    speeds = ac.prepare(cell_job.path, cell_job.process).contours[0].path.speeds
    np.testing.assert_array_equal(speeds, [0.02])
    assert cell_job.path.notes == ("the layer 'MARK' has no contour.",)
    refusals(read, [({"MARK": {}}, "has no layer 'MARK'")])


def test_layers_whose_contours_are_not_selected_are_allowed(folder):
    text = "x,y,contour,layer\n0,0,a,A\n0.06,0,a,A\n0,0.03,b,B\n0.06,0.03,b,B\n"
    (folder / "layers.csv").write_text(text)
    layers = "{A: {speed: 0.02}, B: {speed: 0.01}}"
    one_job = job(folder, f"path: {{file: layers.csv, layers: {layers}, names: [a]}}")
    assert prepare(one_job.program, one_job.process).path.speeds.tolist() == [0.02]


def test_meanings_of_words_in_gcode_are_keys_of_the_job(folder):
    program = "G0 X10 F600|M101|G3 I-10 P2|M103|M2"
    (folder / "part.nc").write_text(program.replace("|", "\n"))
    path = {
        "file": "part.nc",
        "words": {"M101": {"arc": True}, "M103": {"arc": False}},
        "frame": JOB["path"]["frame"],
    }
    with pytest.raises(ac.InvalidInput, match="path.arc_turns"):
        job(folder, path=path)
    for meaning, turns in (("total", 2), ("extra", 3)):
        read = job(folder, path={**path, "arc_turns": meaning})
        (contour,) = read.program.contours
        assert contour.path.length == pytest.approx(turns * 2 * np.pi * 0.01)
        assert [x.value for x in contour.events] == [False]
        assert [x.value for x in read.program.moves if isinstance(x, ac.Event)] == [True]
