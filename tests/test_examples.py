"""Every example runs, and prints the figures that it printed when they were checked.

These figures have a source of their own: 5.327 s and 0.0026 mm RMS of the paper's job, in
tests/golden; 503 mm, the circumference of the tube's seam, 2 pi 80 mm; 0.020 s and 40 ms, the
laser's delay and the dead time that the examples give; 36 and 7.2 rad/s³, the limits of jerk; 23
and 20 1/s, 12 ms, the gains and the dead time that example 14 gives its robot. All others were
printed by the code itself, and say only that nothing changed. The gallery shows the same text.
"""

import re
import runpy
from pathlib import Path

import pytest
from docs.gallery import pages

FOLDER = Path(__file__).parents[1] / "examples"
PRINTED = {
    "01_paper_job": """\
motion 5.327 s, at rest after 5.328 s
contour error 0.0026 mm RMS, 0.0048 mm at most
   0.7137 s  line 1: MAC
   1.1765 s  line 1: MDC
   1.7494 s  corner 1: corner
   2.2801 s  line 2: MAC
   2.8534 s  line 2: AVC
   3.2897 s  line 2: MDC
   3.8528 s  corner 2: corner
   4.4699 s  line 3: MAC
   5.3268 s  line 3: MDC
""",
    "02_your_own_job": """\
none            contour error 0.5264 mm RMS, 0.9561 mm at most
pole_placement  contour error 0.0017 mm RMS, 0.0025 mm at most
""",
    "03_box_edge": """\
596 mm in 3.638 s
  slowest: joint 2 acceleration at s = 0.246 m: 0.0577 of 0.2 m/s
  slowest: joint 3 acceleration at s = 0.450 m: 0.0557 of 0.2 m/s
none             ServoPlant     contour error 0.1128 mm RMS, 0.4234 mm at most
none             RigidBodyPlant contour error 0.2055 mm RMS, 0.7701 mm at most
pole_placement   ServoPlant     contour error 0.0104 mm RMS, 0.0450 mm at most
pole_placement   RigidBodyPlant contour error 0.2150 mm RMS, 0.8458 mm at most
inverse_dynamics ServoPlant     contour error 0.2140 mm RMS, 0.8237 mm at most
inverse_dynamics RigidBodyPlant contour error 0.0013 mm RMS, 0.0088 mm at most
""",
    "04_tube_seam": """\
fixed: From 0.311525 m of 0.502655 m along the path it is out of reach of the arm UR5e: at \
(0.376328, 0.0, 0.318817) m, 0.344959 m along it, the tool stays 0.0341 m away; move the path or \
the arm, or leave turning about the tool axis free.
free:  all 503 mm in 10.22 s
contour error 0.0030 mm at most, torch axis off by 0.0017° at most
""",
    "05_certified": """\
certified in 4.695 s, 5 ms more than the optimum
contour error 0.0003 mm at most; holds for: independent joint servos of order second with kp \
25 1/s and kv 150 1/s, dead time 40 ms; set-points every 4 ms, interpolated linearly; \
accelerations that saturate at the joints' limits
set-points lead by 44 ms
""",
    "09_fastest_path": """\
1 mm: 5.02 s, arcs take 5.34 s; 4.0% less than stops
5 mm, lines 0.1 mm: 4.88 s, arcs take 5.33 s; 5.1% less than parabolas
5 mm: 4.74 s, arcs take 5.33 s; 7.8% less than parabolas
  executed within 0.00 mm of the shaped path
  executed within 4.99 mm of the objective path
seam on a UR5e, 1 mm, ten iterations: 1.32 s, arcs take 1.35 s; 1.9% less than parabolas
""",
    "10_limited_jerk": """\
arcs, no limit of jerk: 5.326 s, contour error 0.0430 mm RMS
  jerk 2.62 rad/s³ between breaks, 259.02 from samples every 4 ms
  set-points ask for 24.56 rad/s², the arm has 0.72
continuous curvature, no limit of jerk: 5.065 s, contour error 0.0056 mm RMS
  jerk 10.53 rad/s³ between breaks, 249.60 from samples every 4 ms
  set-points ask for 23.10 rad/s², the arm has 0.72
jerk 50 times the acceleration: 5.086 s, contour error 0.0020 mm RMS
  jerk 36.00 rad/s³ between breaks, 36.00 from samples every 4 ms
  set-points ask for 2.53 rad/s², the arm has 0.72
jerk 10 times the acceleration: 5.178 s, contour error 0.0004 mm RMS
  jerk 7.20 rad/s³ between breaks, 7.20 from samples every 4 ms
  set-points ask for 0.96 rad/s², the arm has 0.72
the same on arcs, which have to stop: 6.868 s, contour error 0.0005 mm RMS
  jerk 7.20 rad/s³ between breaks, 7.20 from samples every 4 ms
  set-points ask for 0.96 rad/s², the arm has 0.72
""",
    "07_learning": """\
run 1: contour error 1.614 mm RMS, 2.181 mm at most
run 2: contour error 0.038 mm RMS, 0.070 mm at most
run 3: contour error 0.009 mm RMS, 0.028 mm at most
next: 0.003 mm RMS expected, 0.009 mm at most
""",
    "08_learning_from_logs": """\
run 1: 0.0547 mm RMS, 0.1236 mm at most
  the log shows 0.0547 mm; the run began at 1234.5670 s
run 2: 0.0003 mm RMS, 0.0007 mm at most
  the log shows 0.0003 mm; the run began at 1234.5670 s
run 3: 0.0001 mm RMS, 0.0004 mm at most
  the log shows 0.0000 mm; the run began at 1234.5670 s
next: 0.0000 mm expected; finished: False
""",
    "06_drawing": """\
gasket.dxf: 8 contours, 895 mm
40.9 s, contour error 0.0001 mm at most, on handle 3A
  laser on at 0.296 s, 0.020 s ahead
  laser off at 1.857 s, 0.000 s ahead
From 500 mm on, after a stop:
9.9 s, contour error 0.0001 mm at most, on handle 3A
""",
    "11_placement": """\
here: 1.831 s
best of the grid: x 0 mm, y 300 mm: 1.791 s
  2 places refused: reach
5 of 24 places had to be planned
""",
    "12_clearance": """\
post at x = 0.35 m: too near
  post and forearm_link: 5 mm first at 0.866 s
post at x = 0.60 m: clear
  base_link_inertia and upper_arm_link: 15.9 mm or more, at all times
  post and wrist_3_link: 78.6 mm or more, at all times
""",
    "13_batch": """\
9 of 9 jobs done
 40 mm/s, none           5.522 s, 0.0473 mm at most
 40 mm/s, pole_placement 5.522 s, 0.0042 mm at most
 40 mm/s, inverse        5.522 s, 0.0040 mm at most
 80 mm/s, none           3.576 s, 0.0473 mm at most
 80 mm/s, pole_placement 3.576 s, 0.0043 mm at most
 80 mm/s, inverse        3.576 s, 0.0060 mm at most
120 mm/s, none           3.261 s, 0.0473 mm at most
120 mm/s, pole_placement 3.261 s, 0.0044 mm at most
120 mm/s, inverse        3.261 s, 0.2484 mm at most
""",
    "14_identification": """\
joint 1: K_p 23.00 1/s, K_v 151.1 1/s, dead time 12.00 ms
joint 2: K_p 20.00 1/s, K_v 120.0 1/s, dead time 12.00 ms
data sheet: contour error 0.2523 mm RMS, 0.5757 mm at most
identified: contour error 0.0003 mm RMS, 0.0007 mm at most
""",
}
RENEW = "Write the gallery anew: `python -m docs.gallery`."
# A length, a time, or a number with decimals on the edge between two printed ones may come out as
# either, by the rounding of another version of a library: one unit of its last digit. Counts and
# names are exact.
UNITS = 1.0001
# MuJoCo promises no more digits from one of its versions to the next.
OF_RIGID_BODIES = 1e-2
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+(?![\w.])| (?=m[ms]\b)|(?![\w.]))")


def tolerance(number: str, line: str) -> float:
    if number.isdigit():
        return 0.0
    unit = UNITS * 10.0 ** -len(number.strip().partition(".")[2])
    return max(unit, OF_RIGID_BODIES * abs(float(number)) if "RigidBodyPlant" in line else 0.0)


def test_every_example_is_known() -> None:
    assert sorted(x.stem for x in FOLDER.glob("*.py")) == sorted(PRINTED) == list(pages.SHOWN)


@pytest.mark.parametrize("name", PRINTED)
def test_the_gallery_shows_an_example_and_what_it_prints(name: str) -> None:
    page = pages.FOLDER / f"{name}.md"
    assert page.read_text(encoding="utf-8") == pages.page_of(name, PRINTED[name]), RENEW


def test_the_gallery_has_every_example() -> None:
    page = pages.FOLDER / "index.md"
    assert page.read_text(encoding="utf-8") == pages.index(), RENEW


@pytest.mark.parametrize("name", PRINTED)
def test_an_example_prints_its_figures(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    # In this process, where warnings are errors too.
    runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    done = capsys.readouterr()
    assert done.err == ""
    expected, printed = PRINTED[name].splitlines(), done.out.splitlines()
    assert [NUMBER.sub("#", x).split() for x in printed] == [
        NUMBER.sub("#", x).split() for x in expected
    ]
    for line, of in zip(expected, printed, strict=True):
        for want, found in zip(NUMBER.findall(line), NUMBER.findall(of), strict=True):
            assert float(found) == pytest.approx(float(want), abs=tolerance(want, line)), of
