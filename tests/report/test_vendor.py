"""The script that draws figures: its recorded packages, its licences, and its traces."""

import base64
import gzip
import hashlib
import json
import re
from pathlib import Path

from armcontour import report
from armcontour.report.figure import render_page

PACKAGE = Path(report.__file__).parent
VENDOR = PACKAGE / "vendor"
TOOLS = Path(__file__).parents[2] / "tools" / "vendor" / "report"
RECORDED = json.loads((VENDOR / "VENDOR.json").read_text(encoding="utf-8"))
# Traces of the core, which every bundle has.
CORE = {"scatter"}
# A page without figures is not larger [bytes].
LARGEST = 1e6


def bundle():
    return gzip.decompress((VENDOR / "plotly.js.gz").read_bytes())


def test_the_bundle_is_the_recorded_one():
    assert RECORDED["sha256"] == hashlib.sha256(bundle()).hexdigest()


def test_the_versions_are_those_of_the_lock_file_and_have_licences():
    locked = json.loads((TOOLS / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    licences = (VENDOR / "LICENSES.txt").read_text(encoding="utf-8").splitlines()
    assert {x["licence"] for x in RECORDED["packages"]} == {"BSD-3-Clause", "MIT", "Zlib"}
    for package in RECORDED["packages"]:
        name, version = package["name"], package["version"]
        versions = [x["version"] for path, x in locked.items() if path.endswith(f"/{name}")]
        assert version in versions, name
        assert f"{name} {version}" in licences


def test_the_bundle_has_the_traces_of_all_figures():
    sources = [x.read_text(encoding="utf-8") for x in PACKAGE.rglob("*.py")]
    used = {x for text in sources for x in re.findall(r'make_trace\(\s*"(\w+)"', text)}
    entry = (TOOLS / "plotly.cjs").read_text(encoding="utf-8")
    assert used - CORE == set(re.findall(r"plotly\.js/lib/(?!core)(\w+)", entry))


def test_a_page_has_the_bundle_and_the_template_once():
    page = render_page(title="a", about="", source="", chapters=[])
    (packed,) = re.findall(r'<script type="text/plain" id="plotly">(.*?)</script>', page)
    assert gzip.decompress(base64.b64decode(packed)) == bundle()
    assert len(page) < LARGEST
    (template,) = re.findall(r"const template = (.*);\n", page)
    assert json.loads(template) == json.loads((VENDOR / "plotly_white.json").read_text())
