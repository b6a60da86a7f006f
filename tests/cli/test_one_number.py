"""A figure has one value wherever it is shown: print, command, JSON, report, Studio, batch.

`LABELS` has what stands before each figure in texts, `NAMES` where it is in data.
"""

import html
import json
import re
from importlib import resources

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.core.result import nest
from armcontour.studio.tasks.dispatch import do

LIBRARY = resources.files("armcontour.jobs") / "library"
PAPER, PLATE = (yaml.safe_load((LIBRARY / f"{x}.yaml").read_text()) for x in ("paper", "plate"))
# Jobs with one run; that with set-points for rigid bodies is judged on these.
JOBS = {
    **{f"paper {x}": PAPER | {"runs": {x: y}} for x, y in PAPER["runs"].items()},
    "plate": PLATE,
}
QUICK = ("paper optimal", "paper inverse-dynamics", "plate")
# The result, by which all others are judged; None where it has no such figure.
FIGURES = {
    "duration": lambda x: x.trajectory.duration,
    "settled": lambda x: x.judged.settled,
    "rms": lambda x: x.judged.contour_error.rms,
    "largest": lambda x: x.judged.contour_error.max,
    "demand": lambda x: x.judged.demand_ratio.max() if x.judged.demand_ratio.any() else None,
    "clearance": lambda x: None if x.clearance is None else x.clearance.low,
    "assigned length": lambda x: None if x.explanation is None else x.explanation.assigned_length,
    "share": lambda x: None if x.explanation is None else share(x.explanation),
}
# The label of each figure; that of a share of the time is a row of a table.
LABELS = {
    "duration": "motion",
    "settled": "at rest after",
    "rms": "contour error, RMS",
    "largest": "contour error, largest",
    "demand": "joint demand",
    "clearance": "clearance",
    "assigned length": "length at the assigned speed",
    "share": r"assigned velocity\s+[\d.]+ m?s",
}
# The figures of each text.
TEXTS = {
    "print": set(LABELS),
    "job_result": {"duration", "rms", "largest", "clearance"},
    "explanation": {"assigned length", "share"},
    "command": set(LABELS),
    "report": set(LABELS),
}
BATCH = {
    "duration": "duration",
    "settled": "settled",
    "rms": "contour_error.rms",
    "largest": "contour_error.max",
    "demand": "demand_ratio",
}
STUDIO = BATCH | {"clearance": "clearance.low"}
EXPLAINED = {"assigned length": "explanation.assigned_length", "share": "time.assigned velocity"}
JSON = STUDIO | EXPLAINED
# Figures that are those of the experiment, where that judges the run.
JUDGED = ("settled", "rms", "largest", "demand")
UNITS = {"s": 1.0, "ms": 1e-3, "mm": 1e-3, "m": 1.0, "%": 1e-2, "": 1.0}
NUMBER = r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)(?: ?(mm|ms|s|m|%)(?!\w))?"


def share(why):
    """The share of the time for which the assigned velocity binds."""
    return next((x.of_time for x in why.shares if x.name == "assigned velocity"), None)


def numbers(text, label):
    """All numbers after a label, in SI units, and half a unit of the last digit of each."""
    for below, digits, unit in re.findall(rf"^ *{label}\s+(< )?{NUMBER}", text, re.MULTILINE):
        mantissa, _, exponent = digits.partition("e")
        last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        value, tolerance = (0.0, 1.0) if below else (float(digits), 0.501)
        yield value * UNITS[unit], tolerance * last * UNITS[unit]


def side_by_side(table):
    """A printed table with one row as a line for each cell, with its heading."""
    heads, cells = (re.split(r"\s{2,}", x.strip()) for x in table.splitlines()[1:3])
    return "\n".join(f"{head} {cell}" for head, cell in zip(heads, cells, strict=True))


def text_of(page):
    """The text of a page, an element a line."""
    body = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", html.unescape(re.sub(r"<[^>]+>", "\n", body)))


def value_at(data, name):
    """The figure of a name, of several numbers the largest; None if there is none."""
    for key in name.split("."):
        data = None if data is None else data.get(key)
    return None if data is None else float(np.max(data))


def studio(text, folder, run):
    """What the Studio says of a run: its figures, and what takes its time."""
    request = {"text": text, "folder": str(folder), "run": run}
    frame = do("figures", request, lambda step: None)
    picture = do("picture", request, lambda step: None)
    assert frame.header["time"] == picture.header["time"]
    return nest([(x["name"], x["value"]) for x in frame.header["rows"]]), frame.header["time"]


@pytest.mark.parametrize("name", QUICK)
def test_a_result_value_is_the_same_in_all_outputs(name, done, tmp_path):
    check(JOBS[name], done, tmp_path)


def check(data, done, folder):
    """Compare all presenters of a job with one run."""
    text = yaml.safe_dump(data, sort_keys=False)
    (folder / "job.yaml").write_text(text)
    for x in LIBRARY.iterdir():
        (folder / x.name).write_bytes(x.read_bytes())
    job_result = ac.run(ac.read_job(folder / "job.yaml"))
    ((run, result),) = job_result.runs.items()
    printed = done("run", folder / "job.yaml", "--out", folder / "out")
    texts = {
        "print": str(result),
        "job_result": side_by_side(str(job_result)),
        "explanation": str(result.explanation),
        "command": printed,
        "report": text_of((folder / "out" / "report.html").read_text("utf-8")),
    }
    values_by_place = {}
    for presenter, figures in TEXTS.items():
        for x in figures:
            values_by_place[presenter, x] = list(numbers(texts[presenter], LABELS[x]))
    summary = json.loads((folder / "out" / "summary.json").read_text("utf-8"))["runs"][run]
    summary["time"] = {x["name"]: x["of_time"] for x in summary.get("time", ())}
    frame, time = studio(text, folder, run)
    on_rigid_bodies = result.judged is not result.evaluation
    # The page has the very cells of print and report.
    for cells in time:
        line = r"\s+".join(map(re.escape, cells))
        assert all(re.search(line, texts[x]) for x in ("print", "command", "report")), cells
    for x, name in JSON.items():
        part = summary["experiment"] if on_rigid_bodies and x in JUDGED else summary
        values_by_place["JSON", x] = [(value_at(part, name), 0.0)]
    for x, name in STUDIO.items():
        values_by_place["Studio", x] = [(value_at(frame, name), 0.0)]
    (row,) = ac.batch(folder / "job.yaml", {"title": ["batch"]}, workers=0).rows
    for x, name in BATCH.items():
        # A batch has the rows that `run` prints: of some, only that of the experiment.
        printed = {key for key, _ in row.data.walk()}
        judged = on_rigid_bodies and (x in JUDGED or name not in printed)
        values_by_place["batch", x] = [(row.data["experiment." * judged + name].value, 0.0)]
    wrong = []
    for (presenter, x), values in values_by_place.items():
        expected = FIGURES[x](result)
        if expected is None:
            continue
        rounding = 1e-9 * abs(expected) + 1e-13
        if not values or any(
            y is None or abs(y - expected) > tolerance + rounding for y, tolerance in values
        ):
            wrong.append(f"{presenter}: {x} {values}, in the result {expected:.9g}")
    assert not wrong, "\n".join(wrong)
