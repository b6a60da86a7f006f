"""What pages say of tests, sizes and the version is what tools and sources find."""

from __future__ import annotations

import re
from importlib.metadata import distribution
from pathlib import Path

import yaml
from tools import count_tests, install_size

import armcontour as ac

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "testing.md").read_text(encoding="utf-8")


def test_every_file_of_tests_is_counted_in_one_group_of_the_page() -> None:
    files = [x.relative_to(ROOT).as_posix() for x in (ROOT / "tests").rglob("test_*.py")]
    assert {count_tests.group_of(x) for x in files} == set(count_tests.GROUPS)
    table = PAGE.partition(count_tests.BEGIN)[2].partition(count_tests.END)[0]
    rows = [x.strip("| ").split(" | ") for x in table.splitlines() if x.startswith("| ")]
    names, numbers = [x[0] for x in rows[1:-1]], [int(x[1].replace(",", "")) for x in rows[1:-1]]
    assert names == list(count_tests.GROUPS)
    assert min(numbers) > 0 and f"**{sum(numbers):,}**" in rows[-1]


def test_the_page_has_every_soak_of_the_makefile() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(r"^soak:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert recipe is not None
    done = set(re.findall(r"-m (soak.*)$", recipe[1], re.MULTILINE))
    told = re.findall(r"`(soak[^`]*)`", PAGE)
    assert len(done) > 15 and done == set(told)


def test_sizes_are_those_of_the_files_and_brought_packages_are_found() -> None:
    packages = {install_size.plain(x): distribution(x) for x in ("jinja2", "markupsafe", "PyYAML")}
    folder = Path(str(packages["jinja2"].locate_file("jinja2")))
    sources = sum(x.stat().st_size for x in folder.rglob("*.py")) / 1e6
    assert 0 < sources <= install_size.size_of(packages["jinja2"])
    assert install_size.brought_by("jinja2", packages) == {"jinja2", "markupsafe"}
    table = install_size.table(packages, "jinja2")
    total = sum(install_size.size_of(x) for x in packages.values())
    assert table[-1] == f"| **together** | | **{total:.0f}** | |"


def test_the_version_is_the_newest_of_the_changelog_and_that_to_cite() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, newest = re.findall(r"^## (.+)$", changelog, re.MULTILINE)[:2]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert unreleased == "Unreleased"
    assert newest == f"{ac.__version__} - {cited['date-released']}"
    assert cited["version"] == ac.__version__
