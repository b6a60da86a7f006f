"""The version is the same everywhere."""

import re
from pathlib import Path

import yaml

import armcontour as ac

ROOT = Path(__file__).parents[1]


def test_the_version_is_the_newest_of_the_changelog_and_that_to_cite():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.findall(r"^## (\S+)", changelog, re.MULTILINE)[0]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert newest == cited["version"] == ac.__version__
