"""Files for code hosts and package indexes: workflows, hooks, recipe, release."""

import re
import shutil
import tomllib
from pathlib import Path

import pytest
import yaml

from tools import release

ROOT = Path(__file__).parents[2]
GITHUB = ROOT / ".github"
# A source archive has none of these files.
pytestmark = pytest.mark.skipif(not GITHUB.exists(), reason="not a checkout of the repository")
WORKFLOWS = sorted(GITHUB.glob("workflows/*.yml"))
# Extras that a conda recipe leaves out.
DEVELOPERS = {"browser", "test", "docs", "bench", "dev"}
# Packages that have another name on conda-forge.
CONDA_NAMES = {"pin": "pinocchio", "mujoco": "mujoco-python"}


def load(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def targets():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z]+):", makefile, re.MULTILINE))


def recipe_of(target):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    match = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    return match[1]


def jobs(workflow):
    return load(workflow)["jobs"].items()


def commands(job):
    """Commands of a job, once for each entry of its matrix."""
    matrix = job.get("strategy", {}).get("matrix", {})
    entries = matrix.get("include") or [
        {name: value} for name, values in matrix.items() for value in values
    ]
    for step in job.get("steps", []):
        for entry in entries or [{}]:
            text = step.get("run", "")
            for name, value in entry.items():
                text = text.replace(f"${{{{ matrix.{name} }}}}", str(value))
            yield text


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda x: x.stem)
def test_workflows_use_existing_targets_and_files(workflow):
    for name, job in jobs(workflow):
        for command in commands(job):
            assert set(re.findall(r"\bmake ([a-z]+)", command)) <= targets(), command
            for path in re.findall(r"(?<![\w/])\.[a-z]+/\w+", command):
                assert (ROOT / path).is_file(), path
        for step in [job, *job.get("steps", [])]:
            if step.get("uses", "").startswith("./"):
                assert (ROOT / step["uses"]).is_file(), step
            file = step.get("with", {}).get("cache-dependency-path")
            assert file is None or (ROOT / file).is_file(), file
        needs = job.get("needs", [])
        needed = {needs} if isinstance(needs, str) else set(needs)
        assert needed <= {other for other, _ in jobs(workflow)}, name


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda x: x.stem)
def test_workflows_have_few_permissions_and_a_time_limit(workflow):
    assert load(workflow)["permissions"] == {"contents": "read"}
    for name, job in jobs(workflow):
        assert "uses" in job or "timeout-minutes" in job, name
        for step in job.get("steps", []):
            # A secret would be an alternative to trusted publishing.
            assert "secrets." not in str(step)
            # Names of branches and tags are other people's text.
            assert not re.search(r"\$\{\{ *(github|inputs)", step.get("run", "")), step
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False


def test_hooks_are_the_checks_of_make_check():
    checks = re.findall(r"\$\(BIN\)/(.+)|\$\(MAKE\) --no-print-directory (.+)", recipe_of("check"))
    ruff, local = load(ROOT / ".pre-commit-config.yaml")["repos"]
    hooks = [x["id"] for x in ruff["hooks"]]
    assert hooks == ["ruff-format", "ruff-check"]
    made = [x["entry"].removeprefix("make ") for x in local["hooks"]]
    assert set(made) <= targets()
    expected = [("ruff format --check .", ""), ("ruff check .", ""), *(("", x) for x in made)]
    assert checks == expected
    constraints = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    assert ruff["rev"] in [x.replace("ruff==", "v") for x in constraints]


def without_placeholder(folder):
    """A copy of the files that the check of a release reads, without faults."""
    for name in ("pyproject.toml", *release.VERSIONS, str(release.RECIPE)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    replace(folder / "pyproject.toml", "OWNER", "someone")
    replace(folder / "CHANGELOG.md", " (unreleased)", " (2026-01-01)")
    return release.versions(folder)["CITATION.cff"]


def replace(file, old, new):
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")


def test_a_release_is_refused_while_the_owner_is_a_placeholder(tmp_path):
    without_placeholder(tmp_path)
    replace(tmp_path / "pyproject.toml", "someone.github.io", "OWNER.github.io")
    (reason,) = release.faults(root=tmp_path)
    assert "OWNER" in reason


@pytest.mark.parametrize("name", release.VERSIONS)
def test_a_release_is_refused_if_versions_differ(tmp_path, name):
    version = without_placeholder(tmp_path)
    replace(tmp_path / name, version, "9.9.9")
    (reason,) = release.faults(root=tmp_path)
    assert f"{name} (9.9.9)" in reason


def test_a_release_of_a_tag_has_its_version_and_a_date(tmp_path):
    version = without_placeholder(tmp_path)
    (reason,) = release.faults("v9.9.9", tmp_path)
    assert f"v{version}" in reason
    replace(tmp_path / "CHANGELOG.md", " (2026-01-01)", " (unreleased)")
    assert release.faults(root=tmp_path) == []
    (reason,) = release.faults(f"v{version}", tmp_path)
    assert "CHANGELOG.md" in reason


def requirements(entries):
    """Requirements as conda writes them, without conditions on the platform."""
    matches = [re.fullmatch(r"([\w.-]+)(>=[\w.]+)(;.*)?", x) for x in entries]
    return {f"{CONDA_NAMES.get(x[1], x[1])} {x[2]}" for x in matches}


def test_the_recipe_has_the_requirements_of_the_project():
    recipe = load(ROOT / release.RECIPE)
    data = project()
    python = data["requires-python"].removeprefix(">=")
    assert recipe["context"]["python_min"] == python
    needed = recipe["requirements"]
    assert needed["run"][0] == "python >=${{ python_min }}"
    assert set(needed["run"][1:]) == requirements(data["dependencies"])
    extras = []
    for name, added in data["optional-dependencies"].items():
        # The client of Franka, and OCCT without VTK, are on the Python index only.
        if name not in {*DEVELOPERS, "franka", "cad"}:
            extras += added
    assert set(needed["run_constraints"]) == requirements(extras)
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]
    assert requirements(build["requires"]) <= set(needed["host"])
