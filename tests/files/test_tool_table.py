"""The tool table of a job: which tool a program has, and which of its contours a run follows."""

import numpy as np
import pytest
from tests.files.tables import refusals

import armcontour as ac

PART = """G21 G90
T1 M6
S3000 M3
G0 X0 Y0 Z20
G1 Z0 F600
X40
G0 Z20
M5
T2 M6
S4000 M3
M8
G0 X20 Y20
G1 Z-1 F600
X30
G0 Z20
M5
M2
"""
JOB = """
name: two
arm: {name: ur5e, payload: {mass: 0.5 kg, center: [0, 0, 0]}, work: {position: [0.35, -0.15, 0.05]}}
tools: %s
path: {file: part.nc, orientation: {axis: [0, 0, -1]}%s}
process: {tool_change: 2 s}
limits: {speed: 100 mm/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {one: {}}
"""
HEAVY = "{position: [0, 0, 140 mm], payload: {mass: 1.2 kg, center: [0, 0, 60 mm]}}"


@pytest.fixture
def read(tmp_path):
    """Reads the job with a tool table and keys of its path."""
    (tmp_path / "part.nc").write_text(PART, encoding="utf-8")

    def read(table, path="", part=PART, **values):
        (tmp_path / "part.nc").write_text(part, encoding="utf-8")
        (tmp_path / "two.yaml").write_text(JOB % (table, path), encoding="utf-8")
        return ac.read_job(tmp_path / "two.yaml", **values)

    return read


def length(arm):
    """Distance of the tool point from that of the bare arm with all joints at 0 [m]."""
    zero = np.zeros(6)
    bare = ac.load_arm("ur5e", work=ac.Frame(position=(0.35, -0.15, 0.05)))
    return np.linalg.norm(arm.tool_position(zero) - bare.tool_position(zero))


def test_a_job_follows_the_contours_of_one_tool_with_its_frame_and_payload(read):
    table = f"{{T1: [0, 0, 100 mm], T2: {HEAVY}}}"
    for tool, name, reach, mass, speed in (
        ("T1", "line 5", 0.1, 0.5, 3000.0),
        ("T2", "line 13", 0.14, 1.2, 4000.0),
    ):
        job = read(table, f", tool: {tool}")
        assert [x.name for x in job.program.contours] == [name]
        assert length(job.arm) == pytest.approx(reach, abs=1e-12)
        assert job.arm.chain.payload.mass == mass
        last = {x.name: x.value for x in job.program.moves if isinstance(x, ac.Event)}
        assert last["tool"] == float(tool[1]) and last["spindle speed"] == speed
    # The coolant is on with the second tool, and what came before it is off.
    assert last["coolant"] is False and last["spindle"] is False


def test_tools_that_are_alike_run_in_one_job_with_a_rest_between_them(read):
    job = read("{T1: [0, 0, 100 mm], T2: [0, 0, 100 mm]}")
    assert len(job.program.contours) == 2 and length(job.arm) == pytest.approx(0.1, abs=1e-12)
    plan = ac.run(job, simulate=False).runs["one"].trajectory
    (changed,) = (x.t for x in plan.events if x.name == "tool" and x.value == 2.0)
    (rest,) = (x for x in plan.spans if x.kind == "dwell")
    assert rest.t[1] - rest.t[0] == pytest.approx(2.0, abs=1e-12)
    switch_times = [x.t for x in plan.events if (x.name, x.value) == ("spindle", False)]
    assert (switch_times[0], changed) == pytest.approx((rest.t[0], rest.t[0]), abs=1e-12)
    on = [x.t for x in plan.events if (x.name, x.value) == ("spindle", True)]
    assert on == pytest.approx([0.0, rest.t[1]], abs=1e-12)


def test_refuses_tools_that_a_run_cannot_have(read):
    both = "{T1: [0, 0, 100 mm], T2: [0, 0, 120 mm]}"
    refusals(
        lambda x: read(*x),
        [
            ((both,), "T1, T2", "path: {tool: T1}"),
            (("{T1: [0, 0, 100 mm]}",), "T2", "'T1'", "path.tool"),
            ((both, ", tool: T3"), "T3", "T1, T2"),
            ((both, "", PART.replace("T1 M6\n", "")), "selects no tool"),
        ],
    )
    # Without changes of tools the arm's own is used.
    job = read(both, "", PART.replace("T1 M6\n", "").replace("T2 M6\n", ""))
    assert length(job.arm) == pytest.approx(0.0, abs=1e-12)
