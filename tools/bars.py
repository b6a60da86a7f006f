r"""Count repetition: lines per option and per quantity, parameters, modules.

    python -m tools.bars [--list NAME] [--sample SEED]

A line of an option is a line of `src` that has its name as a field of a class, a parameter of a
public function, an entry of the arguments in a docstring, the keyword of a call, or a text such as
"units", "path.units" or "--units"; in the page's JavaScript as a text. A line of a quantity is a
line that reads it from a result (`.duration`) within an f-string, a dictionary with texts as keys,
a tuple or a call that begins with a text, or a call of a function that formats numbers (`FORMAT`);
of JavaScript, any line that reads it. Messages of errors do not count, nor texts of JavaScript such
as "contour_error.rms", which take a row by its name, nor arguments of functions that make a row
(`duration_row`). `OPTIONS` and `QUANTITIES`
list the names, and files in which the same name means something else or is used by an algorithm.
Modules are those of the package in a fresh process.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from statistics import mean

import armcontour as ac

SOURCE = Path(ac.__file__).parent
ROOT = SOURCE.parent.parent
# Names of each option, and files that do not count.
OPTIONS = {
    # Words of G-code, and the units of figures in JSON, have the same name.
    "path.units": (
        "units",
        ".*gcode|files/study_files|jobs/job_result|studies/placement",
    ),
    "path.join_tolerance": ("join_tolerance", ""),
    # The fit of a spline; the distance that a contour was shaped with, a figure; `Shaped`, the
    # arguments of the function `shape`, as those of `round_corners` in geometry.
    "corners.tolerance": (
        "tolerance",
        "geometry|files/(drawings|study_files)|verification|studies"
        "|.*/tracing|program|.*/jerk|.*shaping/(curves|nodes|search|starts)|control"
        "|jobs/(goal|single_corners|automatic_leads|run_plan)|cli/(certify_command|check_command)|files/job_(path|model)"
        "|report/sections/shaping|.*shaping/shaper|planning/options"
        "|studio/(edits/conversion|tasks|static/taskforms)",
    ),
    # Tool speeds as figures; how much of a limit is used; the corner speed of `Rounding`.
    "limits.speed": (
        "speed",
        "geometry|files/drawings|.*(certification|identification)|motion|program"
        "|robot/drives|report|batches|.*constraints|.*/(jerk|topp)|core/text|verification"
        "|planning/(law_checks|paper|end_sp|expl|program|planner)"
        "|studio/picture|robot/limit_use"
        "|jobs/(analog|automatic_leads|run_plan|run_warnings|job_result|run_data|job)|studio/(edits/conversion|static)",
    ),
    # Exports have an interval of their own, and so has `Paper`, the arguments of a function; a
    # preview chooses a longer one.
    "cycle": (
        "cycle",
        "files/(exports|trajectory_file)|cli/(exports|options)|planning/options"
        "|studio/preview|control/(compensation|learning)"
        "|studies/certification|simulation|robot|report|motion|jobs/study|studio/tasks",
    ),
    # `with_reserve` subtracts it.
    "timing.reserve": ("reserve", "studies/certification|motion|jobs/run_plan|planning/law_checks"),
}
# Attributes that hold each quantity, and files that do not count.
SCRIPTS = "|studio/static/(arm3d|layers|motion|notes|playback|trail|view2d)"
QUANTITIES = {
    # Other figures are those of a fit, a recorded run, drawn robots; and a search compares them.
    "RMS of the contour error": (
        r"\.(contour_)?rms\b",
        "control/(identification|learning)|simulation/robustness|studies/certification/(?!certificat)",
    ),
    # Programs for controllers have it as data; logs have one; a refusal's message names it.
    "duration": (
        r"\.duration\b",
        "planning|jobs/job|program/moves|files/exports|studies/certification/(?!certificat)|control",
    ),
    # Shares of the assigned speed, of jerk and of a contour error are other figures; a search
    # computes uses.
    "limit use": (
        r"\.(limit_ratios|certain|used?|limits_used)\b",
        "planning|studies/certification/(?!certificat)",
    ),
    # `least` is a pair of bodies; estimates and ranges of limits have ends, too.
    "clearance": (
        r"\.(low|high|clearance)\b",
        ".*identification|files/robot_file|planning",
    ),
}
FORMAT = re.compile(r"^(mm|digits|\w*seconds|clock|percent|degrees|number|signed|format|str)$")
MECHANISMS = {
    "command line": ("def override(", "files/job_overrides.py"),
    "placement": ("def _override_keys(", "files/study_files.py"),
    "Studio": ("def place_of(", "studio/edits/keys.py"),
    "batches": ("def _put(", "batches/base_job.py"),
    "sweep": ("changes_of(", "studio/tasks/searches.py"),
    "patch": ("def apply_patch(", "*/patch.py"),
}
FUNCTIONS = (ac.plan, ac.read_path, ac.shape, ac.place, ac.export, ac.load_arm)
PAPER = (
    "import armcontour as ac, importlib.resources as r\n"
    "ac.run(ac.read_job(r.files('armcontour.jobs') / 'library' / 'paper.yaml'))\n"
)
COUNT = "import sys\nprint(sum(x.split('.')[0] == 'armcontour' for x in sys.modules))"


def modules() -> Iterator[tuple[str, str]]:
    """Name and text of each module of the package and of its page."""
    for file in sorted(SOURCE.rglob("*.py")) + sorted(SOURCE.rglob("*.js")):
        if "vendor" not in file.parts:
            yield file.relative_to(SOURCE).as_posix(), file.read_text(encoding="utf-8")


def docstrings(tree: ast.Module) -> Iterator[ast.Constant]:
    """Nodes of all docstrings."""
    for x in ast.walk(tree):
        if isinstance(x, ast.FunctionDef | ast.ClassDef | ast.Module) and ast.get_docstring(x):
            yield x.body[0].value


def option_lines(tree: ast.Module, text: str, names: str) -> Iterator[int]:
    """Lines of a Python module that mention an option."""
    lines, documents = text.splitlines(), set(docstrings(tree))
    entry = re.compile(rf" +([\w, ]+, )?({names})(, [\w, ]+)?( \(.*\))?: ")
    named, key = re.compile(names), re.compile(rf"(--|[\w.]+\.)?({names})")
    for x in documents:
        yield from (i for i in range(x.lineno, x.end_lineno + 1) if entry.match(lines[i - 1]))
    for x in ast.walk(tree):
        if isinstance(x, ast.ClassDef):
            fields = (y for y in x.body if isinstance(y, ast.AnnAssign))
            yield from (y.lineno for y in fields if named.fullmatch(ast.unparse(y.target)))
        elif isinstance(x, ast.FunctionDef) and not x.name.startswith("_"):
            arguments = [*x.args.posonlyargs, *x.args.args, *x.args.kwonlyargs]
            yield from (y.lineno for y in arguments if named.fullmatch(y.arg))
        elif isinstance(x, ast.keyword) and named.fullmatch(x.arg or ""):
            yield x.value.lineno
        elif isinstance(x, ast.Constant) and isinstance(x.value, str) and x not in documents:
            if key.fullmatch(x.value.replace("-", "_").replace("__", "--", 1)):
                yield x.lineno


def quantity_lines(tree: ast.Module, attribute: str) -> Iterator[int]:
    """Lines of a Python module that mention a quantity."""
    pattern = re.compile(attribute)
    excluded = {y for x in ast.walk(tree) if is_excluded(x) for y in ast.walk(x)}
    for x in ast.walk(tree):
        if x not in excluded and is_presented(x):
            attributes = (y for y in ast.walk(x) if isinstance(y, ast.Attribute))
            read = (y for y in attributes if y not in excluded and pattern.search(f".{y.attr}"))
            yield from (y.end_lineno for y in read)


def is_excluded(x: ast.AST) -> bool:
    """True if an expression is part of an error message, or creates the row of a figure."""
    return isinstance(x, ast.Raise) or (
        isinstance(x, ast.Call) and ast.unparse(x.func).endswith("_row")
    )


def is_presented(x: ast.AST) -> bool:
    """True if an expression formats or names values."""
    if isinstance(x, ast.Call) and FORMAT.fullmatch(ast.unparse(x.func)):
        return True
    first = {ast.Dict: "keys", ast.Tuple: "elts", ast.Call: "args"}.get(type(x))
    return isinstance(x, ast.JoinedStr) or (first is not None and is_text(getattr(x, first)[:1]))


def is_text(nodes: list[ast.expr]) -> bool:
    """True if a text or f-string is among some nodes."""
    return any(
        isinstance(x, ast.JoinedStr) or (isinstance(x, ast.Constant) and isinstance(x.value, str))
        for x in nodes
    )


@cache
def find_lines() -> dict[str, list[str]]:
    """Lines of each option and quantity, as file:line."""
    lines_by_name: dict[str, set[tuple[str, int]]] = {x: set() for x in (*OPTIONS, *QUANTITIES)}
    for file, text in modules():
        tree = ast.parse(text) if file.endswith(".py") else None
        for name, (pattern, others) in (OPTIONS | QUANTITIES).items():
            skipped = others + (SCRIPTS if name in QUANTITIES else "")
            if (skipped and re.match(skipped, file)) or not re.search(pattern, text):
                continue
            if tree is None:
                script = rf"[\"'.]({pattern})[\"']" if name in OPTIONS else pattern
                rows = text if name in OPTIONS else re.sub(r"\"[^\"\n]*\"", "", text)
                lines = [i for i, x in enumerate(rows.splitlines(), 1) if re.search(script, x)]
            elif name in OPTIONS:
                lines = option_lines(tree, text, pattern)
            else:
                lines = quantity_lines(tree, pattern)
            lines_by_name[name].update((file, i) for i in lines)
    return {name: [f"{file}:{i}" for file, i in sorted(x)] for name, x in lines_by_name.items()}


def mechanisms() -> list[str]:
    """Mechanisms that change a key of a job."""
    return [
        name
        for name, (marker, pattern) in MECHANISMS.items()
        if any(fnmatch(file, pattern) and marker in text for file, text in modules())
    ]


def loaded(program: str) -> int:
    """Number of modules of the package that a program has loaded at its end."""
    run = [sys.executable, "-c", f"{program}\n{COUNT}"]
    return int(subprocess.run(run, check=True, capture_output=True, text=True).stdout.split()[-1])


def texts() -> Iterator[str]:
    """First paragraphs of docstrings, comments, and messages of errors, with their locations."""
    for file, text in modules():
        if not file.endswith(".py"):
            continue
        tree = ast.parse(text)
        for x in docstrings(tree):
            yield f"{file}:{x.lineno} {x.value.split(chr(10) * 2)[0]}"
        for x in ast.walk(tree):
            if isinstance(x, ast.Raise) and isinstance(x.exc, ast.Call) and is_text(x.exc.args[:1]):
                yield f"{file}:{x.lineno} {ast.unparse(x.exc.args[0])}"
        block: list[str] = []
        for i, row in enumerate([*text.splitlines(), ""], 1):
            if row.lstrip().startswith("# "):
                block.append(row.strip())
            elif block:
                yield f"{file}:{i - len(block)} {' '.join(block)}"
                block = []


def main() -> None:
    """Print the counts, the lines of one name, or a sample of texts."""
    parser = argparse.ArgumentParser(description="Count repetition.")
    parser.add_argument("--list", metavar="NAME", help="an option or a quantity: print its lines")
    parser.add_argument("--sample", metavar="SEED", type=int, help="print 100 texts")
    options = parser.parse_args()
    if options.sample is not None:
        print("\n".join(random.Random(options.sample).sample(list(texts()), 100)))
        return
    lines = find_lines()
    if options.list is not None:
        print("\n".join(lines[options.list]))
        return
    for name, x in lines.items():
        print(f"{len(x):5d}  lines of {name}, in {len({y.split(':')[0] for y in x})} files")
    print(f"{mean(len(lines[x]) for x in OPTIONS):5.1f}  lines of an option, mean")
    print(f"{len(mechanisms()):5d}  mechanisms that change a key: {', '.join(mechanisms())}")
    for function in FUNCTIONS:
        count = len(inspect.signature(function).parameters)
        print(f"{count:5d}  parameters of {function.__name__}")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    example = readme.split("```python\n")[1].split("```")[0]
    print(f"{loaded(example):5d}  modules loaded by the job in README.md")
    print(f"{loaded(PAPER):5d}  modules loaded by read_job and run of the paper's job")


if __name__ == "__main__":
    main()
