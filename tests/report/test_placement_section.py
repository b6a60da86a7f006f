"""Maps of a placement: values where they are known, grey where places are refused."""

import numpy as np
import pytest

from armcontour.io import parse_job
from armcontour.placement import KINDS, Axis, Moves, Place, Placement, Verdict
from armcontour.report.sections import placement as section_of
from armcontour.report.sections.placement import GREYS

JOB = """
name: line
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {compensation: {method: none}}}
"""
# Along x, y and yaw, 2 places each.
VERDICTS = (
    Verdict(duration=2.0, bound=1.9, singular=0.3), Verdict(bound=2.5, singular=0.2),
    Verdict(refusal="reach"), Verdict(bound=2.2, singular=0.4),
    Verdict(refusal="reach"), Verdict(refusal="clearance"),
    Verdict(duration=3.0, bound=2.0, singular=0.1), Verdict(refusal="limits"),
)  # fmt: skip


def placement(names: str, shape: tuple[int, ...], verdicts: tuple[Verdict, ...]) -> Placement:
    job = parse_job(JOB)
    values = np.linspace(0.0, 0.1, 2)
    axes = tuple(Axis(name=x, values=values[:n]) for x, n in zip(names.split(), shape, strict=True))
    best = Place(values=dict.fromkeys(names.split(), 0.0), verdict=verdicts[0])
    return Placement(
        job=job,
        run=job.runs[0],
        axes=axes,
        moves=Moves(anchor=np.zeros(3)),
        objective="cycle",
        verdicts=verdicts,
        best=best,
        refined=best,
        own=verdicts[0],
    )


def test_a_map_shows_the_best_over_other_axes_and_refusals_in_grey() -> None:
    section = section_of(placement("x y yaw", (2, 2, 2), VERDICTS))
    assert [name for name, _ in section.choices] == ["duration", "least singular value"]
    (figure,) = section.choices[0][1]
    heat = [x for x in figure.data if x.type == "heatmap"]
    maps = {x.colorbar.title.text if x.colorbar else x.hovertemplate: x for x in heat}
    values = np.array(maps.pop("duration [s]").z, dtype=float)
    # Rows are along y.
    np.testing.assert_array_equal(values, [[2.0, np.nan], [2.2, 3.0]])
    ((words, grey),) = maps.items()
    # At x = 0.1, y = 0 both yaws are refused; the farther from the end of the list names it.
    assert "refused by clearance" in words
    np.testing.assert_array_equal(np.isfinite(np.array(grey.z, dtype=float)), [[0, 1], [0, 0]])
    assert "refused by clearance" in [x.name for x in figure.data]
    (singular,) = section.choices[1][1]
    (heat,) = [x for x in singular.data if x.colorbar]
    np.testing.assert_array_equal(np.array(heat.z, dtype=float), [[0.3, np.nan], [0.4, 0.1]])
    assert "best over the other axes" in section.text and "lower bound" in section.text
    assert ("reach", "2") in section.tables[1].rows


def test_every_kind_of_refusals_has_a_tone() -> None:
    assert tuple(GREYS) == KINDS


def test_one_axis_is_a_line() -> None:
    section = section_of(placement("x y", (2, 1), (VERDICTS[0], VERDICTS[2])))
    (figure,) = section.choices[0][1]
    line, refused = (x for x in figure.data if len(x.x) > 0 and x.name != "best place")
    np.testing.assert_allclose(line.x, [0, 100])
    assert line.y[0] == 2.0 and np.isnan(line.y[1])
    assert refused.name == "refused by reach" and list(refused.x) == [pytest.approx(100.0)]
