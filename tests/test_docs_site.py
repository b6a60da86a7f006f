"""The site of the documentation: nothing is left out of the reference, and beginners find answers.

The pages come from the functions that write them; docs/site/test_built.py judges what is built.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
import yaml
from docs.site import links
from docs.site.names import NO_LIBRARY
from docs.site.written import written

import armcontour as ac
from armcontour import errors
from armcontour.cli.commands import app
from armcontour.studio.edits import EDITS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
STUDIO = ROOT / "src/armcontour/studio"
PAGES = written()
GROUP: Any = typer.main.get_command(app)
ERRORS = [
    x for x in vars(errors).values() if inspect.isclass(x) and issubclass(x, errors.ArmContourError)
]


def read(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def entries() -> list[str]:
    """The names that have an entry of their own, as Sphinx is told to make it."""
    api = "\n".join(text for name, text in PAGES.items() if name.startswith("api/"))
    return re.findall(r"^\.\. auto(?:class|function):: (\S+)$", api, re.MULTILINE)


def rows(text: str) -> list[list[str]]:
    """The cells of all rows of all tables of a page."""
    lines = [x for x in text.splitlines() if x[:1] == "|"]
    return [[y.strip() for y in re.split(r"(?<!\\)\|", x[1:-1])] for x in lines]


def test_every_public_name_has_one_entry() -> None:
    found = entries()
    assert len(set(found)) == len(found)
    public = {f"armcontour.{name}" for name in ac.__all__ if name != "__version__"}
    assert len(public) > 60 and sorted(public - set(found)) == []
    assert "`armcontour.__version__`" in PAGES["api/index.md"]


def test_every_name_of_a_room_has_an_entry() -> None:
    known = [_named(x) for x in entries()]
    missing = []
    for module in pkgutil.iter_modules(ac.__path__):
        if module.name.startswith("_") or module.name in NO_LIBRARY:
            continue
        room = importlib.import_module(f"armcontour.{module.name}")
        for name in getattr(room, "__all__", ()):
            value = getattr(room, name)
            called = inspect.isclass(value) or inspect.isfunction(value)
            if called and not any(x is value for x in known):
                missing.append(f"{module.name}.{name}")
    assert missing == []


def _named(name: str) -> Any:
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(module), last)


@pytest.mark.parametrize("name", GROUP.commands)
def test_every_option_has_a_line_with_its_help_and_default(name: str) -> None:
    lines = {x[0]: x for x in rows(PAGES[f"commands/{name}.md"])}
    for x in GROUP.commands[name].params:
        shown = x.param_type_name == "argument" and x.metavar
        called = [x.metavar] if shown else [*x.opts, *x.secondary_opts]
        (line,) = [y for key, y in lines.items() if f"`{called[0]}`".lower() in key.lower()]
        assert all(f"`{y}`".lower() in line[0].lower() for y in called), line
        assert len(line) == 4 and re.sub(r"[\\`]", "", line[3]) == x.help.replace("`", "")
        if x.required:
            assert line[2] == "needed"
        elif x.default not in (None, False, True):
            assert str(getattr(x.default, "value", x.default)) in line[2]


def test_quantities_of_options_have_their_units() -> None:
    lines = {x[0]: x[1] for x in rows(PAGES["commands/run.md"])}
    assert lines["`--speed`"] == "quantity [m/s]" and lines["`--turn`"] == "quantities [rad]"
    assert lines["`--iterations`"] == "whole number, at least 0" and lines["`--layer`"] == "text"


def test_every_command_is_listed_with_those_of_the_program_itself() -> None:
    listed = PAGES["commands/index.md"]
    assert [x for x in GROUP.commands if f"[{x}]({x}.md)" not in listed] == []
    assert [x.opts for x in GROUP.params if f"`{x.opts[0]}`" not in listed] == []


@pytest.mark.parametrize("error", ERRORS, ids=lambda x: x.__name__)
def test_every_error_has_its_exit_code_and_what_mends_it(error: type[ac.ArmContourError]) -> None:
    page = read("reference/errors.md")
    (row,) = [x for x in rows(page) if x[0] == str(error.exit_code)]
    assert error.__name__ in row[2]
    if error is not ac.ArmContourError:
        section = page.split(f"\n## {error.__name__}\n")[1].split("\n## ")[0]
        assert f"Exit code {error.exit_code}." in section and "](" in section


def test_every_exit_code_that_the_help_names_is_explained() -> None:
    codes = set(re.findall(r"\b\d+\b", GROUP.epilog))
    explained = {y for x in rows(read("reference/errors.md")) for y in re.findall(r"\d+", x[0])}
    assert len(codes) > 8 and codes == explained


def test_the_attributes_of_errors_are_explained() -> None:
    names = set(vars(ac.ArmContourError("No.")))
    explained = {y for x in rows(read("reference/errors.md")) for y in re.findall(r"`(\w+)`", x[0])}
    assert names <= explained


def test_every_message_and_frame_of_the_studio_is_named() -> None:
    page = read("reference/studio.md")
    named = {y for x in re.findall(r"`([^`\n]+)`", page) for y in re.findall(r"\w+", x)}
    sources = "\n".join(x.read_text(encoding="utf-8") for x in STUDIO.rglob("*.py"))
    frames = set(re.findall(r"\bFrame\(\s*\"(\w+)\"", sources))
    # What `Acts` knows, and which method does it.
    acts = (STUDIO / "acts.py").read_text(encoding="utf-8")
    messages = set(re.findall(r"^ +\"(\w+)\": self\.", acts, re.MULTILINE))
    assert len(messages) > 15 and len(EDITS) > 8 and len(frames) > 10
    assert sorted({*messages, *EDITS, *frames} - named) == []


# Each question with its answer.
HEADS = re.split(r"^## (.+)\n", read("questions.md"), flags=re.MULTILINE)
ANSWERS = dict(zip(HEADS[1::2], HEADS[2::2], strict=True))


def test_a_beginner_finds_ten_questions() -> None:
    assert len(ANSWERS) >= 10


@pytest.mark.parametrize("question", ANSWERS)
def test_an_answer_leads_further(question: str) -> None:
    assert len(ANSWERS[question].split()) > 20
    assert re.search(r"\]\([\w/.]+\.md", ANSWERS[question])


def test_the_first_page_names_each_page_once() -> None:
    named = re.findall(r"\]\(([\w./-]+)\)", read("index.md"))
    assert sorted(x for x in set(named) if named.count(x) > 1) == []


@pytest.mark.parametrize(
    ("page", "link", "repository", "mended"),
    [
        ("index", "[x](../README.md)", "", "[x](reference/pages/project/readme.md)"),
        ("index", "[x](guides/job.md#results)", "", "[x](guides/job.md#results)"),
        ("index", "[x](../examples)", "", "x"),
        ("index", "[x](../examples)", "https://host/a", "[x](https://host/a/tree/main/examples)"),
        (
            "concepts/jerk",
            "[x](../../Makefile)",
            "https://host/a",
            "[x](https://host/a/blob/main/Makefile)",
        ),
        (
            "guides/job",
            "[x](../../src/armcontour/__init__.py)",
            "",
            "[x](../reference/pages/api/index.md)",
        ),
        (
            "reference/pages/project/readme",
            "![x](docs/figures/studio_gasket.png)",
            "",
            "![x](../../../figures/studio_gasket.png)",
        ),
    ],
)
def test_links_of_the_repository_become_links_of_the_site(
    page: str, link: str, repository: str, mended: str
) -> None:
    source = [f"before {link} after"]
    links.mend(SimpleNamespace(config=SimpleNamespace(repository=repository)), page, source)
    assert source == [f"before {mended} after"]


def test_the_site_is_published_from_main_only_with_no_more_rights_than_it_needs() -> None:
    flow = yaml.safe_load((ROOT / ".github/workflows/docs.yml").read_text(encoding="utf-8"))
    assert flow["permissions"] == {"contents": "read"}
    build, publish = flow["jobs"]["build"], flow["jobs"]["publish"]
    assert "permissions" not in build
    assert publish["permissions"] == {"pages": "write", "id-token": "write"}
    assert "refs/heads/main" in publish["if"]
    steps = [*build["steps"], *publish["steps"]]
    used = [x["uses"] for x in steps if "uses" in x]
    assert used and all(re.fullmatch(r"actions/[\w-]+@v\d+", x) for x in used)
    assert [x["run"] for x in steps if "run" in x] == ["make site"]


def test_what_the_site_needs_is_the_extra_docs() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {re.split(r"[>=]", x)[0] for x in extras["optional-dependencies"]["docs"]}
    configuration = (DOCS / "conf.py").read_text(encoding="utf-8")
    for package in needed - {"sphinx", "latex2mathml", "matplotlib"}:
        assert package.replace("-", "_") in configuration
