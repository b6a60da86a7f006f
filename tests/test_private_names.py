"""No test imports a private name: a change inside a module breaks no test."""

import ast
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent
ROOT = TESTS.parent
FILES = sorted(TESTS.rglob("*.py"))
# Tests of code that is being rewritten; its new public functions will take the place of these.
EXCEPTIONS = {}


def is_private(name):
    return name.startswith("_") and not (name.startswith("__") and name.endswith("__"))


@cache
def is_module(name):
    """Whether a dotted name is a module of ours; public names of a private module are public."""
    places = [folder.joinpath(*name.split(".")) for folder in (ROOT, ROOT / "src")]
    return any(x.is_dir() or x.with_suffix(".py").is_file() for x in places)


def private_names(tree):
    """Private names that a module imports, or takes from a module that it imports."""
    modules = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for x in node.names:
                ours = is_module(f"{node.module}.{x.name}")
                if is_private(x.name) and not ours:
                    yield x.name
                elif ours or not (node.level or is_module(node.module.partition(".")[0])):
                    modules.add(x.asname or x.name)
        elif isinstance(node, ast.Import):
            modules |= {x.asname or x.name.partition(".")[0] for x in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr):
            owner = ast.unparse(node.value)
            if owner.partition(".")[0] in modules and not is_module(f"{owner}.{node.attr}"):
                yield node.attr
        # monkeypatch.setattr(module, "_name", ...) and the like.
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            for x in node.args[:2] if name.endswith("attr") else ():
                if isinstance(x, ast.Constant) and isinstance(x.value, str):
                    last = x.value.rpartition(".")[2]
                    if is_private(last):
                        yield last


def test_no_test_imports_a_private_name():
    wrong = {}
    for file in FILES:
        name = file.relative_to(TESTS).as_posix()
        private = set(private_names(ast.parse(file.read_text(encoding="utf-8"))))
        if more := private - EXCEPTIONS.get(name, set()):
            wrong[name] = more
    assert not wrong
