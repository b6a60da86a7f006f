"""Options of the command line that set keys of a job."""

import re
from collections.abc import Sequence

import pytest

from armcontour.cli.job_options import EXPORTED_POINTS, EXPORTS, JOB_OPTIONS, TOPICS, to_quantity
from armcontour.core.fields import parts_of
from armcontour.core.quantities import AtLeast, Quantity
from armcontour.files.file_keys import key_fields, kinds_of_keys, leaves, read_keys
from armcontour.files.job_model import JobModel
from armcontour.jobs import Exports

# Values of the options whose help has no example of a quantity.
VALUES = {
    "--arc-turns": "total",
    "--call": True,
    "--contour": ["line 12"],
    "--corner-shape": "free",
    "--derivatives": 1,
    "--export": ["csv", "house.j2"],
    "--ignore-z": True,
    "--layer": ["CUT"],
    "--points": 2,
    "--position": "300 mm, 0 mm, 100 mm",
    "--process-off": True,
    "--rpy": "0, 0, 90 deg",
    "--scale": 2.0,
    "--skip-unknown": True,
    "--tolerances": 1.5,
    "--units": "mm",
    "--waypoint-columns": "x [mm],y [mm],-",
}


def field_at(key):
    """Field of a key path in the dataclasses of a job file."""
    kinds = [JobModel]
    field = None
    for name in key.split("."):
        every = [key_fields(x)[name] for x in kinds if name in key_fields(x)]
        assert every, f"no job has the key {key}"
        field = every[0]
        kinds = [kind for x in leaves(field.hint) for kind in kinds_of_keys(x)]
    return field


@pytest.mark.parametrize("option", JOB_OPTIONS.values(), ids=lambda x: x.name)
def test_an_option_sets_a_key_that_a_job_has(option):
    field = field_at(option.key)
    example = re.search(r"such as '(.+?)'", option.help)
    value = VALUES[option.name] if option.name in VALUES else example[1]
    read = read_keys(field.hint, option.read(value) if option.read else value)
    assert read is not None and read != field.default
    parts = tuple(parts_of(field.hint))
    assert (option.kind is bool) == (bool in parts or option.name == "--skip-unknown")
    assert (option.kind is int) == any(isinstance(x, AtLeast) for x in parts)
    assert option.least == next((x.least for x in parts if isinstance(x, AtLeast)), None)
    repeated = option.kind == list[str]
    assert repeated == (Sequence in parts and option.name not in ("--position", "--rpy", "--edges"))
    assert repeated == option.help.endswith("; may be repeated.")
    if any(isinstance(x, Quantity) and x.unit != "1" for x in parts) and example:
        assert option.read is to_quantity


def test_every_exported_format_and_its_points_have_options():
    keys = {x.key for topic in (EXPORTS, EXPORTED_POINTS) for x in topic.options}
    assert keys == {f"export.{x}" for x in key_fields(Exports)} - {
        "export.outputs",
        "export.inputs",
        "export.servoj",
    }


def test_options_have_different_names_and_keys():
    every = [x for topic in TOPICS for x in topic.options]
    assert len({x.name for x in every}) == len({x.key for x in every}) == len(every)


def test_the_help_lists_options_by_topic_and_keeps_units(done, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    panels = {
        title: {x for x in body.replace(",", "").split() if x.startswith("--")}
        for title, body in re.findall(
            r"^(\w[^\n]*):\n((?:  .*\n)+)", done("run", "--help") + done("certify", "--help"), re.M
        )
    }
    for topic in TOPICS:
        assert {x.name for x in topic.options} <= panels[topic.title]
    for title, option in (
        ("Results", "--out"),
        ("Results", "--force"),
        ("Cell and position of the drawing", "--cell"),
        ("Speed, corners and start", "--set"),
    ):
        assert option in panels[title], title
    assert "x [mm]" in done("show", "--help")
    assert "With the robot:\n  export " in done("--help")
    assert "--no-simulation" in done("run", "--help")
