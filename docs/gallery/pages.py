"""Pages of the gallery: picture, code and output of each example."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import yaml

FOLDER = Path(__file__).parent
EXAMPLES = FOLDER.parents[1] / "examples"
# Output of the examples, which tests compare; its digits are equal on all processors.
PRINTED = yaml.safe_load((FOLDER / "printed.yaml").read_text(encoding="utf-8"))
COLUMNS = 3  # Examples in a row of the index


@dataclass(frozen=True)
class Shown:
    """Alternative text and links of a page.

    Args:
        picture: Alternative text of the picture.
        more: Titles and files of pages that explain the example.
        extra: Extra of the package that the example needs.
    """

    picture: str
    more: dict[str, str]
    extra: str | None = None


SHOWN = {
    "01_paper_job": Shown(
        "The rounded path, coloured by the rule of the timing on each stretch",
        {"the paper's job": "../paper.md", "rounding": "../guides/rounding.md"},
    ),
    "02_your_own_job": Shown(
        "Contour error over time: 0.5 mm without and 0.002 mm with compensation",
        {"compensation": "../guides/compensations.md", "job files": "../guides/job.md"},
    ),
    "03_box_edge": Shown(
        "A UR5e at four times along three edges of a box; sticks show the tool axis",
        {"arms": "../guides/arms.md", "execution": "../guides/execution.md"},
        extra="experiment",
    ),
    "04_tube_seam": Shown(
        "A UR5e and a circular seam around a tube; sticks show the torch axis",
        {"tracing": "../concepts/tracing.md", "arms": "../guides/arms.md"},
    ),
    "05_certified": Shown(
        "Set-points, planned and executed motion of a joint; the set-points lead",
        {"certificate": "../guides/certificate.md"},
    ),
    "06_drawing": Shown(
        "Contours, leads and rapids of a gasket, with the points where the laser is switched",
        {"drawings": "../guides/drawings.md", "programs": "../concepts/programs.md"},
        extra="drawings",
    ),
    "07_learning": Shown(
        "Contour error over time in three runs; the error decreases from run to run",
        {"learning": "../guides/learn.md"},
        extra="experiment",
    ),
    "08_learning_from_logs": Shown(
        "Contour error over time in three runs, with learning from log files",
        {"learning": "../guides/learn.md"},
        extra="experiment",
    ),
    "09_fastest_path": Shown(
        "A drawn corner, its rounding arc, and the fastest path within 5 mm",
        {"shaping": "../concepts/shaping.md", "timing": "../guides/optimal.md"},
        extra="experiment",
    ),
    "10_limited_jerk": Shown(
        "Acceleration of a joint over time, without and with a jerk limit",
        {"limits of jerk": "../guides/jerk.md", "corners": "../guides/rounding.md"},
    ),
    "11_placement": Shown(
        "Map of the cycle time; a star marks the best position, grey marks positions out of reach",
        {"placement of the part": "../guides/placement.md"},
    ),
    "12_clearance": Shown(
        "A UR5e at the first time at which its forearm is too near to a post, and a second post",
        {"clearance": "../concepts/clearance.md", "scenes in jobs": "../guides/job.md"},
        extra="dynamics",
    ),
    "13_batch": Shown(
        "Largest contour error over cycle time, with one line per compensation",
        {"batches": "../guides/batches.md"},
    ),
    "14_identification": Shown(
        "Contour error of a robot with the gains of its data sheet and with identified gains",
        {"guide to identification": "../guides/identify.md"},
    ),
    "15_pipe_saddle": Shown(
        "A pipe with a branch on a positioner and a UR10e at two times; the torch points down",
        {"rails and positioners": "../guides/cells.md"},
    ),
    "16_weld_from_step": Shown(
        "The tube, the seam around its foot, and the torch axes along it",
        {"from a STEP file to a weld": "../guides/step.md"},
        extra="cad,dynamics",
    ),
}
INTRODUCTION = """\
# Gallery

Choose an example that is close to your task, and start from its code. Each page shows a picture,
the code and the output of one file of [examples/](../../examples). The tests run the examples and
compare their [output](printed.yaml).
"""


def title_of(name: str) -> tuple[str, str]:
    """Return title and sentence of an example: its docstring before and after the first colon."""
    text = ast.get_docstring(ast.parse(code_of(name))) or ""
    title, _, rest = text.partition(": ")
    return title, rest[:1].upper() + rest[1:]


def code_of(name: str) -> str:
    """Return the code of an example."""
    return (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")


def page_of(name: str) -> str:
    """Return the page of an example."""
    title, sentence = title_of(name)
    shown = SHOWN[name]
    more = ", ".join(f"[{words}]({file})" for words, file in shown.more.items())
    extra = f" Requires `pip install 'armcontour[{shown.extra}]'`." if shown.extra else ""
    return f"""\
# {title}

{sentence}{extra}

![{shown.picture}]({name}.svg)

<!-- not run: it is examples/{name}.py, which the tests run -->
```python
{code_of(name).rstrip()}
```

Output:

```text
{PRINTED[name].rstrip()}
```

File: [examples/{name}.py](../../examples/{name}.py). Its picture is drawn by `draw_{name[:2]}` of
[pictures.py](pictures.py). More: {more}.
All examples: [gallery](index.md).
"""


def published() -> dict[Path, str]:
    """Map the file of each page of the gallery to its text."""
    pages = {FOLDER / f"{name}.md": page_of(name) for name in SHOWN}
    return pages | {FOLDER / "index.md": index()}


def index() -> str:
    """Return the page with all examples."""
    names = list(SHOWN)
    rows = []
    for k in range(0, len(names), COLUMNS):
        row = names[k : k + COLUMNS]
        rows.append([f"[![{SHOWN[x].picture}]({x}.svg)]({x}.md)" for x in row])
        rows.append([f"[{title_of(x)[0]}]({x}.md)" for x in row])
        if k == 0:
            rows.insert(1, [":---:"] * COLUMNS)
    lines = [" | ".join([*x, *[""] * (COLUMNS - len(x))]) for x in rows]
    table = "\n".join(f"| {x} |" for x in lines)
    tree = "\n".join(["```{toctree}", ":hidden:", "", *names, "```"])
    return f"{INTRODUCTION}\n{table}\n\n{tree}\n"
