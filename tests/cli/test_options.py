"""The short options of the command line, whose file is made from the keys of a job.

    python -m tests.cli.test_options

writes the file again.
"""

from pathlib import Path as FilePath

from tools.job_form import options_text

from armcontour.cli import options

FILE = FilePath(options.__file__).with_name("job_options.json")


def test_the_file_has_the_options_of_the_keys():
    assert FILE.read_text("utf-8") == options_text()


if __name__ == "__main__":
    FILE.write_text(options_text(), "utf-8")
