"""What results print in a terminal, and their `repr`: short, of bounded width, and harmless."""

import dataclasses
from pathlib import Path as FilePath

import numpy as np
from soak.corner_job import CORNER_JOB

import armcontour as ac
from armcontour._describing import MOST_LINES, WIDTH, line_up
from armcontour.io import parse_job
from armcontour.placement.judging import Verdict
from armcontour.placement.placement import Place

# Facts that are printed, by the class of the result.
FACTS = {
    "Certificate": ("contour error at most 0.00419", "of 0.1 mm"),
    "CheckReport": ("joint acceleration", "rad/s²", "kept"),
    "Evaluation": ("2.1855 s of motion", "mm RMS"),
    "Explanation": ("joint 2 acceleration", "%"),
    "RoundedPath": ("rounded 1 corner",),
    "Study": ("only", "2.1855 s"),
    "Placement": ("best place", "x 10 mm, yaw 90°", "refused", "1 by reach"),
    "Program": ("2 contours, 0.5 m", "CUT 1, MARK 1"),
    "Limits": ("joint_torque", "28 N m"),
}


class Jobs(list):
    name = "grid"


def results():
    job = parse_job(CORNER_JOB)
    study = ac.run(job)
    x = study.runs["only"]
    certificate, check = ac.certify(job), ac.check(x.trajectory, job.arm, x.run.limits)
    yield from (job, study, x, certificate, certificate.worst, check, check.worst, job.arm)
    yield from (x.evaluation, x.evaluation.contour_error, x.execution, x.explanation, x.joint_path)
    yield from (x.path.path, x.taught, x.trajectory, x.trajectory.sample(0.1), x.run.limits)
    best = Place(values={"x": 0.01, "yaw": np.pi / 2}, verdict=Verdict(bound=1.4, duration=1.5))
    yield ac.Placement(
        job=job, run=job.runs[0], axes=(), moves=None, objective="cycle", best=best, refined=best,
        verdicts=(best.verdict, Verdict(bound=1.6), Verdict(refusal="reach")),
        own=Verdict(refusal="reach"),
    )  # fmt: skip
    counts, errors = {"done": 300, "refused": 80}, {"Unreachable": 80}
    yield ac.Batch(plan=Jobs(range(400)), folder=FilePath("out"), counts=counts, errors=errors)
    square = ac.Path.polyline([[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]])
    line = ac.Path.polyline([[0, 0], [0.1, 0]])
    contours = ac.Contour(path=square, layer="CUT"), ac.Contour(path=line, layer="MARK")
    yield ac.Program(moves=(contours[0], ac.Dwell(duration=0.5), contours[1]))
    t = np.linspace(0.0, 1.0, 251)
    q = np.column_stack([t, -t])
    yield from (ac.Log(t=t, command=q, measured=q), ac.Recording(t=t, q=q))
    yield dataclasses.replace(ac.load_arm("ur5e").limits, speed=0.25)


def test_results_print_few_lines_and_their_repr_is_one():
    for found in results():
        name, text = type(found).__name__, " ".join(str(found).split())
        lines = str(found).splitlines()
        assert len(lines) <= MOST_LINES + 2 and max(map(len, lines)) < 100, name
        assert all(x in text for x in FACTS.get(name, ())), text
        said = repr(found)
        assert "\n" not in said and len(said) < 1000 and name in said


def test_lines_are_aligned_wrapped_and_harmless():
    rows = [("a", "1", "x"), ("nothing", "", ""), ("long name", "", "yy")]
    assert line_up("Title", rows, columns="><") == "Title\n  a          1  x\n  long name     yy"
    assert line_up("Title") == "Title"
    text = line_up("Title", [("name", "word " * 30)])
    first, *others = text.splitlines()[1:]
    assert all(len(x) <= WIDTH and x.startswith(" " * 8 + "word") for x in others)
    assert text.split() == ["Title", "name", *["word"] * 30]
    lines = line_up("Title", [(f"{k}", "x") for k in range(100)]).splitlines()
    assert len(lines) == MOST_LINES and lines[-2].split() == ["12", "x"] and "87" in lines[-1]
    # Texts of other people do not control the terminal.
    text = line_up("a\x1b[2J", [("b\nc", "d\x07")])
    assert text.splitlines() == ["a\\x1b[2J", "  b\\nc  d\\x07"]
