"""Check that a release can be built, and write its conda recipe.

`python tools/release.py check [TAG]`, which `make release` runs, ends with an error while the
project's addresses contain a placeholder, or where files state different versions. A tag also
needs a changelog without the word "unreleased". `python tools/release.py recipe ARCHIVE` prints the
conda recipe of a source archive.
"""

from __future__ import annotations

import hashlib
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The account at the code host, until a publisher replaces it in pyproject.toml.
PLACEHOLDER = "OWNER"
RECIPE = Path("conda/recipe/recipe.yaml")
# File and pattern of each place that states the version.
VERSIONS = {
    "src/armcontour/_version.py": r'^__version__ = "(.+)"$',
    "CITATION.cff": r"^version: (.+)$",
    "CHANGELOG.md": r"^## (\S+)",
    "README.md": r"Version (\d+\.\d+\.\d+) is tested",
}


def owner(root: Path = ROOT) -> str:
    """Return the account at the code host, from the project's addresses."""
    with (root / "pyproject.toml").open("rb") as file:
        urls = tomllib.load(file)["project"]["urls"]
    return str(urls["Repository"].split("/")[3])


def versions(root: Path = ROOT) -> dict[str, str]:
    """Return the version that each file states."""
    stated = {}
    for name, pattern in VERSIONS.items():
        match = re.search(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        stated[name] = match[1] if match else "no version"
    return stated


def faults(tag: str = "", root: Path = ROOT) -> list[str]:
    """List the reasons why a release cannot be built, one sentence each."""
    reasons = []
    project = (root / "pyproject.toml").read_text(encoding="utf-8")
    addresses = re.search(r"^\[project\.urls\]\n((?:.+\n)*)", project, re.MULTILINE)
    if addresses is None:
        reasons.append("pyproject.toml lacks [project.urls].")
    elif re.search(rf"\b{PLACEHOLDER}\b", addresses[1]):
        reasons.append(
            f"The addresses in [project.urls] of pyproject.toml contain the placeholder "
            f"{PLACEHOLDER}: replace it by the account at the code host."
        )
    stated = versions(root)
    if len(set(stated.values())) > 1:
        reasons.append(f"Versions differ: {', '.join(f'{x} ({y})' for x, y in stated.items())}.")
    version = stated["src/armcontour/_version.py"]
    if tag and tag != f"v{version}":
        reasons.append(f"The tag is {tag}, but the version is {version}: expected v{version}.")
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    if tag and re.search(rf"^## {re.escape(version)} \(unreleased\)$", changelog, re.MULTILINE):
        reasons.append(f'CHANGELOG.md calls {version} "unreleased": write the date.')
    return reasons


def recipe(archive: Path, root: Path = ROOT) -> str:
    """Return the conda recipe of a source archive, with its owner, version and hash."""
    values = {
        PLACEHOLDER: owner(root),
        "VERSION": archive.name.removesuffix(".tar.gz").rpartition("-")[2],
        "SHA256": hashlib.sha256(archive.read_bytes()).hexdigest(),
    }
    text = (root / RECIPE).read_text(encoding="utf-8")
    start = text.index("schema_version")
    return re.sub(rf"\b({'|'.join(values)})\b", lambda x: values[x[1]], text[start:])


def main() -> None:
    """Run the command that the arguments give."""
    match sys.argv[1:]:
        case ["check", *tags] if len(tags) < 2:
            if reasons := faults(*tags):
                sys.exit("\n".join(reasons))
        case ["recipe", archive]:
            print(recipe(Path(archive)), end="")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
