"""The pages of the gallery as text: an example's picture, its code and what it prints."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import yaml

FOLDER = Path(__file__).parent
EXAMPLES = FOLDER.parents[1] / "examples"
# What the examples print, to the last digits that every processor agrees on; tests compare.
PRINTED = yaml.safe_load((FOLDER / "printed.yaml").read_text(encoding="utf-8"))
COLUMNS = 3


@dataclass(frozen=True)
class Shown:
    """What a page says beside the example itself.

    Args:
        picture: What the picture shows, for those who do not see it.
        more: Titles and files of pages that explain it.
    """

    picture: str
    more: dict[str, str]


SHOWN = {
    "01_paper_job": Shown(
        "Three lines with arcs between them, in the colours of acceleration, speed and braking",
        {"the paper's job": "../paper.md", "rounding": "../concepts/rounding.md"},
    ),
    "02_your_own_job": Shown(
        "Contour error over time, 0.5 mm without and 0.002 mm with compensation",
        {"compensation": "../concepts/compensation.md", "job files": "../guides/job.md"},
    ),
    "03_box_edge": Shown(
        "A UR5e at four times along three edges of a box, the tool's axis as sticks",
        {"arms": "../guides/arms.md", "execution": "../guides/execution.md"},
    ),
    "04_tube_seam": Shown(
        "A circle around a tube, the torch pointing at it from all sides, and the UR5e",
        {"tracing": "../concepts/tracing.md", "arms": "../guides/arms.md"},
    ),
    "05_certified": Shown(
        "Set-points of a joint run ahead of the planned motion, which the joint follows",
        {"certificate": "../guides/certificate.md", "robustness": "../concepts/robustness.md"},
    ),
    "06_drawing": Shown(
        "A gasket: its contours, quarter circles that lead onto them, rapids, laser on and off",
        {"drawings": "../guides/drawings.md", "programs": "../concepts/programs.md"},
    ),
    "07_learning": Shown(
        "Contour error over time of three runs, each lower than the one before",
        {"learning, the guide": "../guides/learn.md", "the concept": "../concepts/learning.md"},
    ),
    "08_learning_from_logs": Shown(
        "Contour error over time of three runs, learned from log files",
        {"learning, the guide": "../guides/learn.md", "the concept": "../concepts/learning.md"},
    ),
    "09_fastest_path": Shown(
        "A corner as drawn, as an arc, and as the fastest path within 5 mm",
        {"shaping": "../concepts/shaping.md", "timing": "../guides/optimal.md"},
    ),
    "10_limited_jerk": Shown(
        "Acceleration of a joint over time, with jumps and without",
        {"limits of jerk": "../guides/jerk.md", "corners": "../guides/rounding.md"},
    ),
    "11_placement": Shown(
        "A map of places by cycle time, the best one with a star, those out of reach in grey",
        {"placing the part": "../guides/placement.md"},
    ),
    "12_clearance": Shown(
        "A UR5e whose forearm touches a post, and another post that it stays clear of",
        {"clearance": "../concepts/clearance.md", "scenes in jobs": "../guides/job.md"},
    ),
    "13_batch": Shown(
        "Largest contour error over cycle time, a line for each compensation",
        {"many jobs": "../guides/batches.md"},
    ),
    "14_identification": Shown(
        "Contour error of the same robot with the gains of its data sheet and with identified ones",
        {"identifying, the guide": "../guides/identify.md"},
    ),
}
INTRODUCTION = """\
# Gallery

Every example of [examples/](../../examples) with its picture, its code and what it prints.
`make docs` runs the examples and draws their pictures; tests compare what they print with
[this list](printed.yaml).
"""


def title_of(name: str) -> tuple[str, str]:
    """Title and sentence of an example: its docstring before and after the colon."""
    text = ast.get_docstring(ast.parse(code_of(name))) or ""
    title, _, rest = text.partition(": ")
    return title, rest[:1].upper() + rest[1:]


def code_of(name: str) -> str:
    """The text of an example."""
    return (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")


def page_of(name: str) -> str:
    """The page of an example."""
    title, sentence = title_of(name)
    shown = SHOWN[name]
    more = ", ".join(f"[{words}]({file})" for words, file in shown.more.items())
    return f"""\
# {title}

{sentence}

![{shown.picture}]({name}.svg)

<!-- not run: it is examples/{name}.py, which the tests run -->
```python
{code_of(name).rstrip()}
```

It prints:

```text
{PRINTED[name].rstrip()}
```

File: [examples/{name}.py](../../examples/{name}.py). More: {more}.
All examples: [gallery](index.md).
"""


def index() -> str:
    """The page with all examples."""
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
