"""Straight leads along which the process cuts: they must not cut into the part."""

import numpy as np
import pytest
from tests.geometry.tables import each

import armcontour as ac
from armcontour.files.job_file import parse_job
from armcontour.jobs.run_job import run
from armcontour.program import Contour, Lead, Pierce, Process, Program, Switch, Weave, prepare

HOLE = ac.Path.circle((0.05, 0.03), 0.01)
SLOT = ac.Path.polyline([(0.02, 0.02), (0.03, 0.02), (0.03, 0.04), (0.02, 0.04), (0.02, 0.02)])
PLATE = ac.Path.polyline([(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06), (0, 0)])
BEAM = Switch("laser")


def prepared(path, process):
    program = Program(moves=(Contour(path=PLATE, name="plate"), Contour(path=path, name="inner")))
    return prepare(program, process)


@each("path", [HOLE, SLOT])
@each("leads", ["lead_in", "lead_out"])
@each("length", [1e-3, 5e-3])
def test_a_straight_lead_that_cuts_into_the_part_is_refused(path, leads, length):
    lead = {leads: Lead(length, active=True)}
    with pytest.raises(ac.InvalidInput, match="cut into the part") as error:
        prepared(path, Process(kerf=2e-4, switch=BEAM, begin="drawn", **lead))
    assert "inner" in str(error.value) and error.value.allowed == 0.0
    # A process that pierces cuts as well, also without a kerf.
    with pytest.raises(ac.InvalidInput, match="cut into the part"):
        prepared(path, Process(switch=BEAM, pierce=Pierce(0.1), begin="drawn", **lead))
    # A weave of the contour changes nothing at its leads.
    weave = Weave(width=1e-4, pitch=2e-3)
    with pytest.raises(ac.InvalidInput, match="cut into the part"):
        prepared(path, Process(kerf=2e-4, switch=BEAM, weave=weave, begin="drawn", **lead))


@each("path", [HOLE, SLOT])
def test_the_remedies_of_the_refusal_keep_the_tool_out_of_the_part(path):
    arcs = {x: Lead(1e-3, shape="arc", active=True) for x in ("lead_in", "lead_out")}
    inner = prepared(path, Process(kerf=2e-4, switch=BEAM, **arcs)).contours[0]
    points = inner.path(np.linspace(0, inner.path.length, 2001))
    if path is HOLE:
        assert np.linalg.norm(points - (0.05, 0.03), axis=1).max() <= 0.01 - 1e-4 + 1e-9
    else:
        assert (points >= np.array([0.0201, 0.0201]) - 1e-9).all()
        assert (points <= np.array([0.0299, 0.0399]) + 1e-9).all()
    # With the process off, the tool may pass over the part.
    off = {x: Lead(1e-3) for x in ("lead_in", "lead_out")}
    assert len(prepared(path, Process(kerf=2e-4, switch=BEAM, **off)).contours) == 2


def test_straight_leads_outside_the_part_or_on_the_cut_are_kept():
    # At a corner of the plate, the lead-in comes from outside along the first edge. In the middle
    # of an edge, both leads are on the contour, which is cut anyway.
    leads = {x: Lead(2e-3, active=True) for x in ("lead_in", "lead_out")}
    program = Program(moves=(Contour(path=PLATE, name="plate"),))
    for begin in ("drawn", "auto"):
        process = Process(kerf=2e-4, switch=BEAM, begin=begin, **leads)
        (outer,) = prepare(program, process).contours
        # The offset outline has quarter circles around its corners.
        length = 0.32 + 2 * np.pi * 1e-4
        assert outer.path.length == pytest.approx(length + 4e-3, abs=1e-9)
    # Without a kerf, pierce or arcs in the waste, nothing is cut through: a bead of glue.
    assert len(prepared(HOLE, Process(switch=BEAM, **leads)).contours) == 2


def test_a_job_refuses_a_straight_lead_out_at_a_hole(tmp_path):
    text = """\
name: cut
arm: pmk3s
path: {file: rings.ngc, frame: {position: [0.32, 0.20, 0]}}
process: {kerf: 0.2 mm, switch: {name: laser}, lead_out: {length: 2 mm, active: true}}
limits: {speed: 50 mm/s}
corners: {tolerance: 0.1 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {}}
"""
    (tmp_path / "rings.ngc").write_text(
        "G21 G90 F3000\nG0 X40 Y0\nG3 X40 Y0 I-40 J0\nG0 X10 Y0\nG3 X10 Y0 I-10 J0\nM2\n"
    )
    with pytest.raises(ac.InvalidInput, match="cut into the part"):
        run(parse_job(text, folder=tmp_path))
    arc = text.replace("{length: 2 mm, active", "{length: 2 mm, shape: arc, active")
    assert run(parse_job(arc, folder=tmp_path), simulate=False).runs["only"].trajectory is not None
