"""Pages and tools agree with the sources: groups of tests, soaks, the version."""

import re
from pathlib import Path

import yaml
from tools import count_tests

import armcontour as ac

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "testing.md").read_text(encoding="utf-8")


def test_every_file_of_tests_is_in_one_group_of_the_page():
    places = [x.relative_to(ROOT).as_posix() for x in (ROOT / "tests").rglob("test_*.py")]
    files = [x for x in places if not x.startswith("tests/slow/")]
    assert {count_tests.group_of(x) for x in files} == set(count_tests.GROUPS)
    table = PAGE.partition(count_tests.BEGIN)[2].partition(count_tests.END)[0]
    rows = [x.strip("| ").split(" | ") for x in table.splitlines() if x.startswith("| ")]
    assert [x[0] for x in rows[1:-1]] == list(count_tests.GROUPS)


def test_the_page_has_every_soak_of_the_makefile():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(r"^soak:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    done = set(re.findall(r"-m (soak.*)$", recipe[1], re.MULTILINE))
    assert len(done) > 15 and done == set(re.findall(r"`(soak[^`]*)`", PAGE))


def test_the_version_is_the_newest_of_the_changelog_and_that_to_cite():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    unreleased, newest = re.findall(r"^## (.+)$", changelog, re.MULTILINE)[:2]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert unreleased == "Unreleased"
    assert newest == f"{ac.__version__} - {cited['date-released']}"
    assert cited["version"] == ac.__version__
