"""The site of the documentation: nothing is left out of the reference, and beginners find answers.

The pages come from the functions that write them; docs/site/test_built.py judges what is built.
"""

import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import typer
from docs.site.names import NO_LIBRARY, rooms
from docs.site.written import written

import armcontour as ac
from armcontour.cli.commands import program_for
from armcontour.core import errors

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = written()
GROUP = typer.main.get_command(program_for())


def read(name):
    return (DOCS / name).read_text(encoding="utf-8")


def entries():
    """The names that have an entry of their own, as Sphinx is told to make it."""
    api = "\n".join(text for name, text in PAGES.items() if name.startswith("api/"))
    return re.findall(r"^\.\. auto(?:class|function):: (\S+)$", api, re.MULTILINE)


def rows(text):
    """The cells of all rows of all tables of a page."""
    lines = [x for x in text.splitlines() if x[:1] == "|"]
    return [[y.strip() for y in re.split(r"(?<!\\)\|", x[1:-1])] for x in lines]


def test_every_public_name_has_one_entry_in_the_reference():
    names = entries()
    assert len(set(names)) == len(names)
    public = {f"armcontour.{name}" for name in ac.__all__ if name != "__version__"}
    assert len(public) > 60 and sorted(public - set(names)) == []
    assert "`armcontour.__version__`" in PAGES["api/index.md"]
    parts = (x.rpartition(".") for x in names)
    documented = {id(getattr(importlib.import_module(module), name)) for module, _, name in parts}
    missing = []
    packages = {x.name for x in pkgutil.iter_modules(ac.__path__) if x.ispkg}
    assert packages - set(rooms()) == set(NO_LIBRARY)
    for name in rooms():
        room = importlib.import_module(f"armcontour.{name}")
        members = {name: getattr(room, name) for name in getattr(room, "__all__", ())}
        called = {
            key: x for key, x in members.items() if inspect.isclass(x) or inspect.isfunction(x)
        }
        missing += [f"{name}.{key}" for key, x in called.items() if id(x) not in documented]
    assert missing == []


def test_every_command_is_listed_and_quantities_of_options_have_their_units():
    lines = {x[0]: x[1] for x in rows(PAGES["commands/run.md"])}
    kinds = {
        "`--speed`": "quantity [m/s]", "`--rpy`": "quantities [rad]",
        "`--layer`": "text",
    }  # fmt: skip
    assert {name: lines[name] for name in kinds} == kinds
    listed = PAGES["commands/index.md"]
    assert [x for x in GROUP.commands if f"[{x}]({x}.md)" not in listed] == []
    assert [x.opts for x in GROUP.params if f"`{x.opts[0]}`" not in listed] == []


def test_every_error_has_its_exit_code_its_attributes_and_a_fix():
    page = read("reference/errors.md")
    table = rows(page)
    for error in vars(errors).values():
        if inspect.isclass(error) and issubclass(error, ac.ArmContourError):
            (row,) = [x for x in table if x[0] == str(error.exit_code)]
            assert error.__name__ in row[2]
            if error is not ac.ArmContourError:
                (row,) = [x for x in table if x[0].startswith(f"`{error.__name__}`")]
                assert "](" in row[1]
    codes = set(re.findall(r"\b\d+\b", GROUP.epilog))
    assert len(codes) > 8 and codes == {y for x in table for y in re.findall(r"\d+", x[0])}
    explained = {y for x in table for y in re.findall(r"`(\w+)`", x[0])}
    assert set(vars(ac.ArmContourError("No."))) <= explained
