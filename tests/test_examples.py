"""Examples print the lines in docs/gallery/printed.yaml; tests/slow has the longer ones."""

import contextlib
import io
import re
import runpy

import pytest
from docs.gallery import pages
from tests.dynamics_extra import mark_all_but

QUICK = (
    *("01_paper_job", "02_your_own_job", "06_drawing", "08_learning_from_logs"),
    *("12_clearance", "14_identification"),
)
# A length, a time, or a number with decimals on the edge between two printed ones may come out as
# either, by the rounding of another version of a library: one unit of its last digit. Counts and
# names are exact.
UNITS = 1.0001
# Results of different versions of MuJoCo agree only to these digits.
OF_RIGID_BODIES = 1e-2
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+(?![\w.])| (?=m[ms]\b)|(?![\w.]))")


def tolerance(number, line):
    if number.isdigit():
        return 0.0
    unit = UNITS * 10.0 ** -len(number.strip().partition(".")[2])
    return max(unit, OF_RIGID_BODIES * abs(float(number)) if "RigidBodyPlant" in line else 0.0)


def check_example(name):
    """Run an example in this process, where warnings are errors too, and compare its output."""
    printed = io.StringIO()
    errors = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        runpy.run_path(str(pages.EXAMPLES / f"{name}.py"), run_name="__main__")
    assert errors.getvalue() == ""
    expected = pages.PRINTED[name].splitlines()
    actual = printed.getvalue().splitlines()
    words, expected_words = ([NUMBER.sub("#", x).split() for x in y] for y in (actual, expected))
    assert words == expected_words
    for want, got in zip(expected, actual, strict=True):
        for a, b in zip(NUMBER.findall(want), NUMBER.findall(got), strict=True):
            assert float(b) == pytest.approx(float(a), abs=tolerance(a, want)), got


def test_the_gallery_shows_every_example_and_its_code():
    assert sorted(x.stem for x in pages.EXAMPLES.glob("*.py")) == list(pages.SHOWN)
    assert list(pages.PRINTED) == list(pages.SHOWN)
    for name in pages.SHOWN:
        page = pages.page_of(name)
        assert pages.code_of(name).rstrip() in page and pages.PRINTED[name].rstrip() in page
        assert f"({name}.md)" in pages.index()


@pytest.mark.parametrize("name", mark_all_but(QUICK, {*QUICK} - {"12_clearance"}))
def test_an_example_prints_its_figures(name):
    check_example(name)
