"""The short options of the command line, whose file is made from the keys of a job.

    python -m tests.cli.test_options

writes the file again.
"""

import re
from pathlib import Path as FilePath

from tools.job_form import options_text

from armcontour.cli import command_line

FILE = FilePath(command_line.__file__).with_name("job_options.json")


def test_the_stored_file_of_options_is_up_to_date():
    assert FILE.read_text("utf-8") == options_text()


def test_the_help_lists_options_by_topic_and_keeps_units(done, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    panels = {
        title: {x for x in body.replace(",", "").split() if x.startswith("--")}
        for title, body in re.findall(r"^(\w[^\n]*):\n((?:  .*\n)+)", done("run", "--help"), re.M)
    }
    for title, option in (
        ("Results", "--out"),
        ("Results", "--force"),
        ("Options", "--no-simulation"),
        ("Drawing", "--waypoint-columns"),
        ("Cell and position of the drawing", "--cell"),
        ("Speed, corners and start", "--speed"),
        ("Points of these files", "--point-tolerance"),
    ):
        assert option in panels[title], title
    assert "x [mm]" in done("show", "--help")
    assert "With the robot:\n  export " in done("--help")


if __name__ == "__main__":
    FILE.write_text(options_text(), "utf-8")
