"""Lines, rows and entities of files in errors: the test reads the files on its own."""

import re

import numpy as np
import pytest

import armcontour as ac
from armcontour.cli import main
from armcontour.program.corner_rounding import smooth_curvature

ezdxf = pytest.importorskip("ezdxf")

# Number of moves of a contour, and the move whose end is far out of reach.
MOVES = 120
FAR_MOVE = 77
FAR = (1500.0, 0.0)
MM = 1e-3


def zigzag(far=FAR):
    """Return points of a contour in mm, one of which may be out of reach."""
    x = 300.0 + np.linspace(0.0, 100.0, MOVES + 1)
    y = 5.0 * (np.arange(MOVES + 1) % 2)
    points = np.column_stack([x, y])
    if far is not None:
        points[FAR_MOVE + 1] = far
    return points


def gcode(points, numbers=True):
    """Write a program with comments, blank lines, modal words and block numbers out of step."""
    lines = ["%", "(a contour)", "G21 G90 G17", f"G0 X{points[0, 0]:.3f} Y{points[0, 1]:.3f}"]
    for k, (x, y) in enumerate(points[1:]):
        if k % 7 == 3:
            lines += ["", f"(comment {k})"]
        number = f"N{10 * k + 5 * (k % 3)} " if numbers and k % 5 else ""
        word = {0: "G1 ", 1: "", 2: "G01"}[k % 3] if k else "G1 F3000 "
        lines.append(f"{number}{word}X{x:.3f} Y{y:.3f}")
    return "\n".join([*lines, "M2", "%", ""])


def line_with(text, x):
    """Find the line with a coordinate X [mm]; return its number and its block number."""
    for number, line in enumerate(text.split("\n"), start=1):
        if re.search(rf"X{x:.3f}\b", line):
            block = re.match(r"N(\d+)", line)
            return number, None if block is None else int(block[1])
    raise AssertionError("the file has no such line")


def name_of(number, block):
    return f"line {number}" if block is None else f"line {number} (N{block})"


def refusal(call):
    with pytest.raises(ac.ArmContourError) as refused:
        call()
    return refused.value


@pytest.mark.parametrize("numbers", [True, False])
def test_errors_name_the_line_and_the_block_of_g_code(numbers, tmp_path):
    text = gcode(zigzag(), numbers)
    (tmp_path / "part.ngc").write_text(text)
    expected = name_of(*line_with(text, FAR[0]))
    assert ("N" in expected) == numbers
    program = ac.read_path(tmp_path / "part.ngc")
    arm = ac.load_arm("pmk3s")
    for path in (program, program.path):
        error = refusal(lambda path=path: ac.plan(path, arm, ac.Limits(speed=0.1)))
        assert error.origin == expected
        assert f"{expected}: " in str(error)
    # An arm in space, with a tool axis
    axis = program.placed(ac.Frame((0.0, 0.0, 0.3))).pointing((0, 0, -1))
    error = refusal(lambda: ac.plan(axis, ac.load_arm("ur5e"), ac.Limits(speed=0.1)))
    assert error.origin == expected


def csv(points):
    rows = [f"{x:.3f},{y:.3f}" for x, y in points]
    rows[40:40] = ["# a comment", ""]
    return "\n".join(["# waypoints", "x [mm],y [mm]", *rows, ""])


def test_errors_name_the_row_of_waypoints(tmp_path):
    text = csv(zigzag())
    (tmp_path / "part.csv").write_text(text)
    expected = 1 + next(k for k, x in enumerate(text.split("\n")) if x.startswith(f"{FAR[0]:.3f},"))
    program = ac.read_path(tmp_path / "part.csv")
    error = refusal(lambda: ac.plan(program, ac.load_arm("pmk3s"), ac.Limits(speed=0.1)))
    assert error.origin == f"line {expected}"


def write_dxf(file, points):
    """Write one LINE per move, in a random order, with a first entity that sets the direction."""
    document = ezdxf.new(units=4)
    order = [0, *(1 + np.random.default_rng(3).permutation(MOVES - 1))]
    for k in order:
        document.modelspace().add_line(points[k], points[k + 1], dxfattribs={"layer": "CUT"})
        # Circles on another layer take handles as well.
        document.modelspace().add_circle((0, 0), 1 + k, dxfattribs={"layer": "OTHER"})
    document.saveas(file)


def handle_at(file, point):
    """Find the handle of the line that ends at a point [mm]."""
    lines = ezdxf.readfile(file).modelspace().query("LINE")
    return next(x.dxf.handle for x in lines if np.allclose(tuple(x.dxf.end)[:2], point))


def test_errors_name_the_entity_of_a_dxf_drawing(tmp_path):
    file = tmp_path / "part.dxf"
    write_dxf(file, zigzag())
    program = ac.read_path(file, ac.ReadOptions(layers=["CUT"]))
    assert len(program.contours) == 1 and len(program.path) == MOVES
    error = refusal(lambda: ac.plan(program, ac.load_arm("pmk3s"), ac.Limits(speed=0.1)))
    for word in ("LINE", f"handle {handle_at(file, FAR)} ", "CUT"):
        assert word in error.origin
    assert error.origin in str(error)


def test_errors_name_the_element_of_an_svg_drawing(tmp_path):
    points = " ".join(f"{x},{y}" for x, y in zigzag())
    line = f'<polyline id="seam" points="{points}" fill="none" stroke="black"/>'
    head = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="2000mm" height="9mm" viewBox="0 0 2000 9"'
    )
    (tmp_path / "part.svg").write_text(f"{head}>\n\n{line}\n</svg>\n")
    program = ac.read_path(tmp_path / "part.svg")
    error = refusal(lambda: ac.plan(program, ac.load_arm("pmk3s"), ac.Limits(speed=0.1)))
    assert "seam" in error.origin and "line 3" in error.origin


# A robot in space, whose drawing has its own frame.
JOB = """
name: part
arm:
  name: ur5e
  tool:
    position: [0, 0, 120 mm]
    shapes: [{type: sphere, name: tip, at: [0, 0, 90 mm], radius: 30 mm}]
path:
  file: part.ngc
  frame: {position: [0, 0, 0.3]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {one: {timing: {method: optimal}, compensation: {method: inverse}}}
scene: {floor: none, obstacles: []}
"""


def test_jobs_and_the_command_line_name_the_line(tmp_path, monkeypatch, capsys):
    text = gcode(zigzag())
    (tmp_path / "part.ngc").write_text(text)
    expected = name_of(*line_with(text, FAR[0]))
    (tmp_path / "job.yaml").write_text(JOB)
    error = refusal(lambda: ac.run(ac.read_job(tmp_path / "job.yaml")))
    assert error.origin == expected and expected in str(error)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "sys.argv", ["armcontour", "run", "part.ngc", "--cell", "pmk3s", "--out", "out"]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr().err
    assert ended.value.code == 3, printed
    assert expected in printed


# Lines and arcs that are tangent, and one corner at the end of the fourth move.
CORNER = """G21 G90 F6000
G0 X300 Y0
G1 X350
G3 X370 Y20 R20
(up)
G1 Y40
N70 G1 Y70
G1 X340 Y80
G1 X300 Y80
"""


def test_notes_and_warnings_name_the_line(tmp_path):
    (tmp_path / "part.ngc").write_text(CORNER)
    (tmp_path / "job.yaml").write_text(JOB.replace("limits: {", "limits: {joint_jerk: 80, "))
    result = ac.run(ac.read_job(tmp_path / "job.yaml"), simulate=False)
    # The first full stop is at the end of line 7. The curvature first jumps at the end of line 3.
    (note,) = [x for x in result.to_data().parts["runs"].parts["one"].notes if "full stop" in x]
    assert "line 7 (N70)" in note
    (warning,) = [x for x in result.runs["one"].warnings if "full stop" in x]
    assert "line 3." in warning


def test_results_name_the_line_of_the_largest_error_and_of_the_slowest_point(tmp_path):
    (tmp_path / "part.ngc").write_text(CORNER)
    (tmp_path / "job.yaml").write_text(JOB.replace("scene:", "corners: {tolerance: 1 mm}\nscene:"))
    result = ac.run(ac.read_job(tmp_path / "job.yaml")).runs["one"]
    data = result.to_data()
    rows = {x.name: x for x in data.rows}
    s = result.evaluation.contour_error.s_max
    # Lengths of the path up to the ends of the moves, whose corners are rounded by less than 3 mm.
    ends = np.cumsum([50, 10 * np.pi, 20, 30, np.hypot(30, 10), 40])
    lines = np.array([3, 4, 6, 7, 8, 9])
    near = {int(lines[np.searchsorted(ends, x).clip(0, 5)]) for x in (1e3 * s - 3, 1e3 * s + 3)}
    named = rows["contour_error.origin"].value
    assert near & {int(x) for x in re.findall(r"\d+", named)}
    assert rows["contour_error.max"].note.endswith(named)


def test_collisions_name_the_line(tmp_path):
    points = zigzag(far=None)
    text = gcode(points)
    # The middle of one move is 60 mm lower, where it meets an obstacle.
    lines = text.split("\n")
    number, block = line_with(text, points[61, 0])
    lines[number - 1] += " Z-60"
    after = next(k for k in range(number, len(lines)) if "X" in lines[k])
    lines[after] += " Z0"
    (tmp_path / "part.ngc").write_text("\n".join(lines))
    x, y = points[61]
    obstacle = f"{{type: sphere, name: ball, at: [{x * MM}, {y * MM}, 0.24], radius: 5 mm}}"
    (tmp_path / "job.yaml").write_text(JOB.replace("obstacles: []", f"obstacles: [{obstacle}]"))
    error = refusal(lambda: ac.run(ac.read_job(tmp_path / "job.yaml")))
    assert isinstance(error, ac.Collision), error
    assert error.origin == name_of(number, block)


def test_merged_moves_are_named_by_their_lines(tmp_path):
    # Short moves along one line become one segment.
    lines = ["G21 G90 F3000", "G0 X300 Y0"]
    lines += [f"G1 X{300 + 5 * k} Y{0.001 * (k % 2):.3f}" for k in range(1, 101)]
    (tmp_path / "part.ngc").write_text("\n".join(lines))
    program = ac.read_path(tmp_path / "part.ngc")
    assert len(program.path) == 1
    error = refusal(lambda: ac.plan(program, ac.load_arm("pmk3s"), ac.Limits(speed=0.1)))
    assert error.origin == "lines 3 to 102"


def arcs_and_lines(tmp_path):
    """A ring of lines and arcs, and the ends of its moves by line, in mm."""
    text = """G21 G90 F3000
(ring)
G0 X0 Y0
G1 X60
N40 X60 Y20
G2 X80 Y40 I20 J0

G1 X110 Y45
N80 G3 X120 Y70 R20
G1 X60 Y90
(back)
X-10 Y60
N120 X0 Y0
M2
"""
    (tmp_path / "ring.ngc").write_text(text)
    return ac.read_path(tmp_path / "ring.ngc")


def distances(path, lines_of):
    """Return the distance of the middle of each segment from the move of its line [m]."""
    found = []
    for k in range(len(path)):
        middle = (path.breaks[k] + path.breaks[k + 1]) / 2
        origin = ac.Contour(path=path).origin_at(middle)
        first, last = re.match(r"lines? (\d+)(?: to (\d+))?", origin).groups()
        numbers = range(int(first), int(last or first) + 1)
        points = np.concatenate([x for line, x in lines_of.items() if line in numbers])
        found.append(np.linalg.norm(points - path(middle)[:2], axis=1).min())
    return np.array(found)


def points_by_line(program):
    """Return points on the moves by the line of the file, which the test reads on its own."""
    ends = {4: (60, 0), 5: (60, 20), 6: (80, 40), 8: (110, 45), 9: (120, 70), 10: (60, 90),
            12: (-10, 60), 13: (0, 0)}  # fmt: skip
    centers = {6: (80.0, 20.0, 20.0)}
    points = {}
    start = np.zeros(2)
    for line, end in ends.items():
        end = np.array(end, dtype=float)
        u = np.linspace(0, 1, 2001)[:, None]
        if line == 9:
            # The centre is to the left of the chord, on its bisector.
            chord = end - start
            left = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
            center = (start + end) / 2 + np.sqrt(400 - chord @ chord / 4) * left
            radius = 20.0
        elif line in centers:
            *center, radius = centers[line]
        drawn = start + u * (end - start)
        if line in (6, 9):
            away = drawn - np.array(center)
            drawn = np.array(center) + radius * away / np.linalg.norm(away, axis=1)[:, None]
        points[line] = MM * drawn
        start = end
    return points


@pytest.mark.parametrize("change", ["drawn", "rounded", "smooth", "curvature", "kerf", "reversed"])
def test_changed_paths_keep_the_lines_of_their_parts(change, tmp_path):
    program = arcs_and_lines(tmp_path)
    allowed = 1e-9
    if change in ("rounded", "smooth"):
        # Half of a rounded corner is on the line after the vertex.
        continuity = "curvature" if change == "smooth" else "tangent"
        program = ac.round_corners(program, tolerance=1e-3, continuity=continuity)
        allowed = 3e-3
    elif change == "curvature":
        program = smooth_curvature(program, tolerance=1e-3)
        allowed = 3e-3
    elif change == "kerf":
        program = ac.prepare(program, ac.Process(kerf=2e-3))
        allowed = 1e-3 + 1e-6
    elif change == "reversed":
        program = ac.Program.from_path(program.path.reversed())
    lines_of = points_by_line(program)
    away = distances(program.path, lines_of)
    # The points on the moves are 0.05 mm apart.
    assert away.max() <= allowed + 5e-5


def test_origins_need_one_integer_per_segment(tmp_path):
    path = arcs_and_lines(tmp_path).path
    assert path.segments.origins.nbytes == 8 * len(path)
