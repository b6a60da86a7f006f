"""What the page takes from others is what was bundled, with licences, and is in the wheel."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from armcontour.studio import server

ROOT = Path(__file__).parents[2]
VENDOR = server.STATIC / "vendor"
TOOLS = ROOT / "tools" / "vendor"
# The page may not make an installation much larger [bytes].
MOST = 1_500_000


def recorded() -> list[dict[str, object]]:
    return json.loads((VENDOR / "VENDOR.json").read_text())  # type: ignore[no-any-return]


def test_the_bundles_are_those_that_were_made() -> None:
    listed = {}
    for library in recorded():
        assert isinstance(library["files"], list)
        listed |= {x["file"]: x["sha256"] for x in library["files"]}
    there = {x.name for x in VENDOR.iterdir() if x.suffix in (".js", ".css")}
    assert there == set(listed)
    for name, digest in listed.items():
        assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == digest, name


def test_the_versions_are_those_of_the_lock_file_and_have_licences() -> None:
    locked = json.loads((TOOLS / "package-lock.json").read_text())["packages"]
    licences = (VENDOR / "LICENSES.txt").read_text()
    for library in recorded():
        name = library["name"]
        assert locked[f"node_modules/{name}"]["version"] == library["version"]
        assert library["licence"] == "MIT" and f"{name} {library['version']}" in licences
    assert licences.count("Permission is hereby granted") == len(recorded())


def test_the_lock_file_names_no_host() -> None:
    for name in ("package.json", "package-lock.json", ".npmrc"):
        assert "://" not in (TOOLS / name).read_text()


def test_bundles_ask_for_nothing_and_evaluate_nothing() -> None:
    for file in VENDOR.glob("*.js"):
        text = file.read_text()
        assert not re.search(r"\bimport\s*\(|\bfrom\s*[\"']|\beval\(|new Function\(", text), file


def test_the_page_is_in_the_wheel_and_is_small() -> None:
    files = [x for x in server.STATIC.rglob("*") if x.is_file()]
    assert sum(x.stat().st_size for x in files) < MOST
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("This is no clone: what git ignores, and the wheel leaves out, is not known.")
    # The wheel leaves out what git ignores.
    names = "\n".join(str(x) for x in files)
    asked = subprocess.run(
        ["git", "check-ignore", "--stdin"], input=names, cwd=ROOT, capture_output=True, text=True
    )
    assert asked.returncode == 1 and asked.stdout == ""
