"""Imports go down only, also those that tools do not see: for types, lazy, and in strings."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import armcontour as ac

ENGINE = (
    "core geometry robot motion program planning verification control simulation paper jobs studies"
)
UPPER = tuple(f"armcontour.{x}" for x in ("files", "report", "cli", "studio", "controllers"))


def test_no_string_of_the_engine_names_an_upper_package():
    root = Path(ac.__file__).parent
    files = []
    for package in ENGINE.split():
        files += (root / package).rglob("*.py")
    assert len(files) > 150
    found = []
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
            if is_text and node.value.startswith(UPPER):
                found.append(f"{file.relative_to(root)}, line {node.lineno}: {node.value}")
    assert not found


def modules():
    """Parsed modules of the package by name, without the packages' own files."""
    root = Path(ac.__file__).parent
    return {
        ".".join(("armcontour", *file.relative_to(root).with_suffix("").parts)): ast.parse(
            file.read_text(encoding="utf-8")
        )
        for file in root.rglob("*.py")
        if file.name != "__init__.py"
    }


def homes():
    """Module of each lazy name, by `package.name`, from the lists `_HOME` of all packages."""
    root = Path(ac.__file__).parent
    found = {}
    for file in root.rglob("__init__.py"):
        package = ".".join(("armcontour", *file.relative_to(root).parent.parts))
        for statement in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "_HOME":
                for module, names in ast.literal_eval(statement.value).items():
                    found |= {f"{package}.{name}": f"{package}.{module}" for name in names.split()}
    return found


def imported(tree, known, lazy):
    """Modules that a module imports anywhere: in functions and for types, too."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or node.module is None:
            continue
        for name in (x.name for x in node.names):
            module = node.module
            while f"{module}.{name}" in lazy:
                module = lazy[f"{module}.{name}"]
            if f"{module}.{name}" in known:
                module = f"{module}.{name}"
            if module in known:
                yield module


def test_no_modules_import_each_other_in_a_circle():
    known = modules()
    lazy = homes()
    assert lazy["armcontour.jobs.RunResult"] == "armcontour.jobs.run_result"
    graph = {name: {*imported(tree, known, lazy)} - {name} for name, tree in known.items()}
    assert "armcontour.jobs.run_record" in graph["armcontour.jobs.rows"]
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError(" <- ".join(error.args[1])) from None
