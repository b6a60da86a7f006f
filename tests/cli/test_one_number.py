"""A figure has one value wherever it is shown: print, command, JSON, report, Studio, batch.

`LABELS` has what stands next to each figure in the text of each presenter; `#` is the number with
its unit. JSON and batches have names in place of labels.
"""

import html
import json
import re
from importlib import resources

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.batches.columns import RUN, figures_of
from armcontour.studio.handles import handles_of
from armcontour.studio.picture import picture_frame
from armcontour.studio.preview import Previewer
from armcontour.studio.tasks.working import do
from armcontour.studio.view import View

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
    "assigned time": lambda x: assigned_time(x.explanation),
}
LABELS = {
    "print": {
        "duration": r"^Run .*: #",
        "settled": r"at rest after #",
        "rms": r"^  contour error +# RMS",
        "largest": r"^  contour error .* RMS, # largest",
        "demand": r"^  joint demand / limit +#",
        "clearance": r"^  clearance +#",
    },
    "study": {
        "duration": r"^  \S+ +# ",
        "rms": r"^  \S+ +\S+ s +# ",
        "largest": r"^  \S+ +\S+ s +\S+ mm +# ",
        "demand": r"  #$",
    },
    "explanation": {
        "assigned length": r", # of the length as assigned",
        "assigned time": r"^  assigned velocity .* s +#",
    },
    "command": {
        "duration": r"^motion #",
        "settled": r"^at rest #",
        "rms": r"^RMS error #",
        "largest": r"^largest #",
        "demand": r"^demand / limit #",
        "clearance": r"nearer than #",
    },
    "report": {
        "duration": r"^motion\n#$",
        "settled": r"^at rest after #",
        "rms": r"^contour error, RMS\n#",
        "largest": r"^contour error, largest\n#",
        "demand": r"^joint demand / limit\n#",
        "clearance": r"nearer than #",
        "assigned time": r"^assigned velocity\n.*%\n#",
    },
    "JSON": {
        "duration": "duration",
        "settled": "settled",
        "rms": "contour_error.rms",
        "largest": "contour_error.max",
        "demand": "demand_ratio",
        "clearance": "clearance.pairs.nowhere_below",
        "assigned length": "explanation.assigned_length",
    },
    "Studio": {
        "duration": "duration",
        "settled": "settled",
        "rms": "rms",
        "largest": "max",
        "demand": "demand",
        "clearance": "clearance.low",
        "assigned time": "shares.assigned velocity",
    },
    "batch": {
        "duration": "duration",
        "settled": "settled",
        "rms": "contour_error.rms",
        "largest": "contour_error.max",
        "demand": "demand_ratio",
    },
}
# What differs where rigid bodies judge the run.
ON_BODIES = {
    "print": {
        "settled": None,
        "rms": r"^  in the experiment +# RMS",
        "largest": r"^  in the experiment .* RMS, # largest",
        "demand": None,
    },
    "command": {
        "rms": r"^experiment: RMS error #",
        "largest": r"^experiment: largest #",
        "demand": None,
    },
    "report": {
        "settled": None,
        "rms": r"^experiment: contour error, RMS\n#",
        "largest": r"^largest #, on rigid bodies",
        "demand": None,
    },
    "JSON": {x: f"experiment.{LABELS['JSON'][x]}" for x in ("settled", "rms", "largest", "demand")},
    "batch": {
        "settled": None,
        "rms": "experiment.contour_error.rms",
        "largest": "experiment.contour_error.max",
        "demand": None,
    },
}
UNITS = {"s": 1.0, "ms": 1e-3, "mm": 1e-3, "m": 1.0, "%": 1e-2, "": 1.0}
NUMBER = r"(-?\d+(?:\.\d+)?(?:e-?\d+)?)(?: ?(mm|ms|s|m|%)\b)?"


def assigned_time(why):
    shares = () if why is None else why.shares
    return next((x.of_time for x in shares if x.name == "assigned velocity"), None)


def numbers(text, pattern):
    """All numbers at a label, in SI units, and half a unit of the last digit of each."""
    number = NUMBER.replace(r"%)\b", r"%)(?!\w)")
    for digits, unit in re.findall(pattern.replace("#", number), text, re.MULTILINE):
        mantissa, _, exponent = digits.partition("e")
        last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        yield float(digits) * UNITS[unit], 0.501 * last * UNITS[unit]


def with_units(printed):
    """A table of the command line as lines of headings with their cells and units."""
    lines = [re.split("[┃│]", x)[1:-1] for x in printed.splitlines() if x[:1] in ("┃", "│")]
    count = sum(x[:1] == "┃" for x in printed.splitlines())
    heads = [" ".join(map(str.strip, x)).strip() for x in zip(*lines[:count], strict=True)]
    for cells in lines[count:]:
        seen = set()
        for head, cell in zip(heads, cells, strict=True):
            name, _, unit = head.rstrip("]").partition(" [")
            yield f"{'experiment: ' if name in seen else ''}{name} {cell.strip()} {unit}"
            seen.add(name)


def text_of(page):
    """The text of a page, an element a line."""
    body = re.sub(r"<(script|style)\b.*?</\1>", "", page, flags=re.DOTALL)
    return re.sub(r"\s*\n\s*", "\n", html.unescape(re.sub(r"<[^>]+>", "\n", body)))


def value_at(data, name):
    """The figure of a name; of a list the largest, of clearances the least."""
    for key in name.split("."):
        data = [x[key] for x in data] if isinstance(data, list) and data else data and data[key]
    if np.ndim(data):
        return float((np.min if "pairs" in name else np.max)(data))
    return data


def studio(text, folder, run):
    """What the Studio says of a run: its figures, and its shares of the time."""
    frame = do("figures", {"text": text, "folder": str(folder), "run": run}, lambda step: None)
    previewer = Previewer(folder)
    data = yaml.safe_load(text)
    handles = handles_of(previewer.job(data, run), data)
    planned = previewer.plan(data, run, exact=True)
    picture = picture_frame(planned, View(handles.plane, handles.centre))
    shares = {x["name"]: x["share"] for x in picture.header["shares"]}
    return frame.header | {"shares": shares}


@pytest.mark.parametrize("name", QUICK)
def test_a_figure_has_one_value_wherever_it_is_shown(name, done, tmp_path):
    check(JOBS[name], done, tmp_path)


def check(data, done, folder):
    """Compare all presenters of a job with one run."""
    text = yaml.safe_dump(data, sort_keys=False)
    (folder / "job.yaml").write_text(text)
    for x in LIBRARY.iterdir():
        (folder / x.name).write_bytes(x.read_bytes())
    study = ac.run(ac.read_job(folder / "job.yaml"))
    ((run, result),) = study.runs.items()
    printed = done("run", folder / "job.yaml", "--out", folder / "out")
    columns = [x for x in {**LABELS["batch"], **ON_BODIES["batch"]}.values() if x]
    columns += LABELS["batch"].values()
    shown = {
        "print": str(result),
        "study": str(study),
        "explanation": str(result.explanation),
        "command": "\n".join([*with_units(printed), printed]),
        "report": text_of((folder / "out" / "report.html").read_text("utf-8")),
        "JSON": json.loads((folder / "out" / "summary.json").read_text("utf-8"))["runs"][run],
        "Studio": studio(text, folder, run),
        "batch": {x: figures_of(result, [x], RUN)[0] for x in columns},
    }
    wrong = []
    for presenter, labels in LABELS.items():
        if result.run.judge is not None:
            labels = labels | ON_BODIES.get(presenter, {})
        for figure, label in labels.items():
            value = FIGURES[figure](result)
            if value is None or label is None:
                continue
            if isinstance(shown[presenter], str):
                found = list(numbers(shown[presenter], label))
            elif presenter == "batch":
                found = [(shown[presenter][label], 1e-9 * abs(value))]
            else:
                found = [(value_at(shown[presenter], label), 1e-9 * abs(value) + 1e-12)]
            if not found or any(x is None or abs(x - value) > off for x, off in found):
                wrong.append(f"{presenter}: {figure} {found}, in the result {value:.9g}")
    assert not wrong, "\n".join(wrong)
