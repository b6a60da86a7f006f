"""Files of the page: bundles, licences, sizes, and no requests to other hosts."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from armcontour.studio import server

ROOT = Path(__file__).parents[2]
VENDOR = server.SHARED / "vendor"
TOOLS = ROOT / "tools" / "vendor"
RECORDED = json.loads((VENDOR / "VENDOR.json").read_text())
FILES = [x for x in (*server.SHARED.rglob("*"), *server.STATIC.rglob("*")) if x.is_file()]
OWN = {x.name: x.read_text() for x in sorted(FILES) if "vendor" not in x.parts}
MODULES = {name: text for name, text in OWN.items() if name.endswith(".js")}
PAGE = OWN["index.html"]
# The page may not make an installation much larger [bytes].
MOST = 1_500_000


def test_the_bundles_have_the_recorded_hashes():
    listed = {x["file"]: x["sha256"] for library in RECORDED for x in library["files"]}
    there = [x for x in VENDOR.iterdir() if x.suffix in (".js", ".css")]
    assert listed == {x.name: hashlib.sha256(x.read_bytes()).hexdigest() for x in there}
    # They ask for nothing, and evaluate nothing.
    for file in VENDOR.glob("*.js"):
        text = file.read_text()
        assert not re.search(r"\bimport\s*\(|\bfrom\s*[\"']|\beval\(|new Function\(", text), file


# Words that each licence has once.
GRANTS = {"MIT": "Permission is hereby granted", "Apache-2.0": "2. Grant of Copyright License."}


def test_the_versions_are_those_of_the_lock_file_and_have_licences():
    locked = json.loads((TOOLS / "package-lock.json").read_text())["packages"]
    licences = (VENDOR / "LICENSES.txt").read_text()
    for library in RECORDED:
        name = library["name"]
        assert locked[f"node_modules/{name}"]["version"] == library["version"]
        assert library["licence"] in GRANTS and f"{name} {library['version']}" in licences
    for licence, grant in GRANTS.items():
        assert licences.count(grant) == sum(x["licence"] == licence for x in RECORDED)
    for name in ("package.json", "package-lock.json", ".npmrc"):
        assert "://" not in (TOOLS / name).read_text()


def test_the_page_is_in_the_wheel_and_is_small():
    assert sum(x.stat().st_size for x in FILES) < MOST
    # The wheel leaves out what git ignores; the package may be of another clone than these tests.
    clone = next((x for x in server.STATIC.parents if (x / ".git").exists()), None)
    if shutil.which("git") is None or clone is None:
        pytest.skip("This is no clone: what git ignores, and the wheel leaves out, is not known.")
    command = ["git", "check-ignore", "--stdin"]
    names = "\n".join(map(str, FILES))
    ignored = subprocess.run(command, input=names, cwd=clone, capture_output=True, text=True)
    assert ignored.returncode == 1 and ignored.stdout == "", ignored.stderr


def test_the_page_requests_nothing_that_its_policy_forbids():
    assert set(re.findall(r"<script[^>]*>(.*?)</script>", PAGE, re.DOTALL)) == {""}
    assert not re.findall(r"<style|\sstyle=|\son\w+=", PAGE)
    links = re.findall(r'(?:src|href)="([^"]+)"', PAGE)
    assert all(x.startswith(("/static/", "#", "data:")) for x in links)
    for name, text in OWN.items():
        elsewhere = set(re.findall(r"https?://[^\s\"'`)]+", text)) - {"http://www.w3.org/2000/svg"}
        assert not elsewhere, name
        assert not re.findall(r"innerHTML|outerHTML|insertAdjacentHTML|\beval\(", text), name
    # What modules look for is on the page.
    there = set(re.findall(r'\sid="([\w-]+)"', PAGE + "".join(MODULES.values())))
    there |= set(re.findall(r'\bid: "([\w-]+)"', "".join(MODULES.values())))
    for name, text in MODULES.items():
        selectors = set(re.findall(r'find\("#([\w-]+)"', text))
        assert selectors <= there, name
