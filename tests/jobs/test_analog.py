"""Analog outputs over the time of a plan, against the executed geometry of the plan itself."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pandas as pd
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.geometry import Demand, Line
from armcontour.io.drawings.gcode import read_gcode
from armcontour.io.drawings.reading import Reading
from armcontour.jobs import analog_outputs
from armcontour.program import Analog, Contour, Event, Lead, Process, Program, Switch, prepare

SLOW, FAST = 0.02, 0.05
LEAD = 2e-3
POWER = Analog(name="power", rest=0.2, full=1.0)


def planned(process: Process, limits: ac.Limits) -> tuple[ac.Trajectory, Program]:
    lines = [
        Line(start=[0.30, 0.20], end=[0.34, 0.20], demand=Demand(speed=SLOW)),
        Line(start=[0.34, 0.20], end=[0.38, 0.20]),
    ]
    gap = Event(name="laser", value=False, s=0.01), Event(name="laser", value=True, s=0.013)
    first = Contour(path=ac.Path.from_segments(lines), events=gap)
    second = Contour(path=ac.Path.polyline([[0.38, 0.24], [0.30, 0.24]]))
    program = prepare(Program(moves=(first, second)), process)
    return ac.plan(program, ac.load_arm("pmk3s"), limits), program


@pytest.fixture(scope="module")
def process() -> Process:
    lead = Lead(length=LEAD)
    outputs = (
        POWER,
        Analog(name="flow", rest=0.0, full=8.0, speed=0.1, off=-1.0),
        Analog(name="early", rest=0.2, full=1.0, lead_time=0.05),
    )
    return Process(lead_in=lead, lead_out=lead, switch=Switch(name="laser"), analog=outputs)


@pytest.fixture(scope="module")
def limits() -> ac.Limits:
    return ac.load_arm("pmk3s").limits.replace(speed=FAST)


def test_values_follow_the_tool_along_free_corners() -> None:
    # Along a shaped curve, arc lengths and the tool differ in speed, by 2e-6 here.
    path = ac.Path.polyline([[0.30, 0.18], [0.34, 0.16], [0.36, 0.20], [0.32, 0.21]])
    arm = ac.load_arm("pmk3s")
    fast = arm.limits.replace(speed=0.1)
    shaped = ac.shape(path, arm, fast, tolerance=2e-3)
    program, plan = Program.of(shaped), ac.plan(shaped, arm, fast)
    power = analog_outputs(program, plan, Process(analog=(POWER,)), fast)["power"]
    t = np.linspace(0, plan.duration, 2001)[:-1]
    speed = np.linalg.norm(arm.tool_velocity(plan(t), plan(t, 1)), axis=1)
    np.testing.assert_allclose(power(t), 0.2 + 0.8 * speed / 0.1, rtol=0, atol=1e-8)


def test_values_follow_the_speed_of_the_tool(process: Process, limits: ac.Limits) -> None:
    trajectory, program = planned(process, limits)
    functions = analog_outputs(program, trajectory, process, limits)
    t = np.linspace(-0.1, trajectory.duration + 0.1, 4001)
    inside = (t >= 0) & (t <= trajectory.duration)
    arm = ac.load_arm("pmk3s")
    q, dq = (trajectory(t[inside], order) for order in (0, 1))
    tool, velocity = arm.forward(q), arm.tool_velocity(q, dq)
    x, y = tool.T
    # Off in leads, in the rapid and where the contour switches the laser off; by the tool alone.
    first = (np.abs(y - 0.20) < 1e-6) & (x >= 0.30) & (x <= 0.38)
    second = (np.abs(y - 0.24) < 1e-6) & (x >= 0.30) & (x <= 0.38)
    on = (first & ~((x >= 0.31) & (x < 0.313))) | second
    assigned = np.where(first & (x < 0.34), SLOW, FAST)
    speed = np.linalg.norm(velocity, axis=1)
    power = functions["power"](t)
    np.testing.assert_array_equal(power[~inside], 0.0)
    expected = np.where(on, 0.2 + 0.8 * speed / assigned, 0.0)
    np.testing.assert_allclose(power[inside], expected, atol=1e-6)
    assert power.max() == pytest.approx(1.0, abs=1e-6) and (power <= 1.0).all()
    flow = functions["flow"](t)
    np.testing.assert_allclose(flow[inside], np.where(on, 80 * speed, -1.0), atol=1e-5)
    np.testing.assert_allclose(functions["early"](t), functions["power"](t + 0.05), atol=1e-12)


def test_outputs_are_on_while_the_tool_pierces_and_along_active_leads(limits: ac.Limits) -> None:
    lead = Lead(length=LEAD, active=True)
    pierced = Process(
        lead_in=lead,
        lead_out=Lead(length=LEAD),
        pierce=ac.Pierce(time=0.25),
        switch=Switch(name="laser"),
        analog=(POWER,),
    )
    trajectory, program = planned(pierced, limits)
    power = analog_outputs(program, trajectory, pierced, limits)["power"]
    for span in trajectory.contour_spans:
        assert span.work is not None
        start, (begin, end) = span.t[0], span.work
        t = np.array([start - 0.26, start - 0.24, start - 0.01, (start + begin) / 2, end + 1e-3])
        values = power(t)
        np.testing.assert_allclose(values[[0, 1, 2, 4]], [0.0, 0.2, 0.2, 0.0], atol=1e-9)
        assert values[3] > 0.2
    laser = [x.t for x in trajectory.events if x.value is True]
    assert laser[0] == pytest.approx(trajectory.contour_spans[0].t[0] - 0.25)


def test_layers_have_outputs_of_their_own(limits: ac.Limits) -> None:
    lines = [ac.Path.polyline([[0.30, y], [0.34, y]]) for y in (0.20, 0.22, 0.24)]
    drawn = [
        Contour(path=x, layer=of) for x, of in zip(lines, ("CUT", "MARK", "NONE"), strict=True)
    ]
    gas = Analog(name="gas", rest=3.0, full=3.0, off=1.0)
    process = Process(
        analog=(POWER,), by_layer={"MARK": {"analog": (gas,)}, "NONE": {"analog": ()}}
    )
    program = prepare(Program(moves=tuple(drawn)), process)
    trajectory = ac.plan(program, ac.load_arm("pmk3s"), limits)
    functions = analog_outputs(program, trajectory, process, limits)
    cut, mark, none = (np.mean(x.t) for x in trajectory.contour_spans)
    times = np.array([cut, mark, none])
    np.testing.assert_allclose(functions["power"](times), [1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_array_equal(functions["gas"](times), [1.0, 3.0, 1.0])
    # A constant needs no assigned velocity.
    only = dataclasses.replace(process, analog=())
    lifted = limits.replace(speed=None)
    found = analog_outputs(program, trajectory, only, lifted)["gas"](times)
    np.testing.assert_array_equal(found, [1.0, 3.0, 1.0])


def test_exports_have_a_column_that_belongs_to_the_times_of_the_plan(
    process: Process, limits: ac.Limits, tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    trajectory, program = planned(process, limits)
    analog = analog_outputs(program, trajectory, process, limits)
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    taught = ac.compensate(trajectory, servo, period=0.004)
    assert taught.start_time < 0
    expected = np.column_stack([of(taught.t) for of in analog.values()])
    assert expected.any(axis=0).all()
    for ending in ("csv", "parquet", "npz"):
        ac.export(taught, tmp_path / f"a.{ending}", analog=analog)
    columns = [f"analog {x.name}" for x in process.analog]
    for found in (pd.read_csv(tmp_path / "a.csv"), pd.read_parquet(tmp_path / "a.parquet")):
        np.testing.assert_allclose(found[columns], expected, rtol=0, atol=1e-12)
    with np.load(tmp_path / "a.npz") as stored:
        # Times of the table count from the first set-point, and back: by some rounding errors.
        np.testing.assert_allclose(stored["analog"], expected, rtol=0, atol=1e-12)
        assert stored["analog_name"].tolist() == [x.name for x in process.analog]
    text = "{% for p in points %}{{ p.analog.power|fixed(6) }}\n{% endfor %}"
    (tmp_path / "own.j2").write_text(text)
    ac.export(taught, tmp_path / "a.txt", analog=analog, template=tmp_path / "own.j2")
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.txt"), expected[:, 0], atol=1e-6)
    refuses(
        lambda: ac.export(taught, tmp_path / "a.yaml", analog=analog),
        InvalidInput,
        "ros-yaml has no place for the analog output power",
    )
    short = {"power": lambda t: t[1:]}
    refuses(lambda: ac.export(taught, tmp_path / "b.csv", analog=short), InvalidInput, "shape")


def test_refuses_outputs_without_a_full_speed_and_odd_ones(
    process: Process, limits: ac.Limits, refuses: Callable[..., None]
) -> None:
    trajectory, program = planned(process, limits)
    lifted = limits.replace(speed=None)
    refuses(
        lambda: analog_outputs(program, trajectory, process, lifted),
        InvalidInput,
        "power",
        "contour 1",
        "limits.speed",
    )
    own = dataclasses.replace(process, analog=(process.analog[1],))
    assert list(analog_outputs(program, trajectory, own, lifted)) == ["flow"]
    refuses(lambda: Process(analog=(POWER, POWER)), InvalidInput, "same name")
    refuses(lambda: Analog(name=" "), InvalidInput, "name")
    refuses(lambda: Analog(name="x", speed=0.0), InvalidInput, "speed", "x")
    refuses(lambda: Analog(name="x", full=float("nan")), InvalidInput, "full", "x")


def test_a_whole_number_while_off_leaves_all_values_as_they_are(limits: ac.Limits) -> None:
    whole = Process(analog=(dataclasses.replace(POWER, off=0),))
    trajectory, program = planned(whole, limits)
    t = np.linspace(0, trajectory.duration, 101)
    expected = analog_outputs(program, trajectory, Process(analog=(POWER,)), limits)["power"](t)
    assert 0.2 < expected.mean() < 1.0
    np.testing.assert_array_equal(
        analog_outputs(program, trajectory, whole, limits)["power"](t), expected
    )


@pytest.mark.parametrize(
    ("text", "travels"),
    [
        # Travels of slicers are G1 without E; M5 and M3 stand between the moves of a laser.
        (b"M83\nG1 X310 Y200 F1200\nG1 X320 E1\nG1 X340\nG1 X360 E1\n", [(0, 310), (320, 340)]),
        (b"G1 X310 Y200 F1200\nM8\nM3\nG1 X320\nM9\nM5\nG1 X340\nM3\nG1 X360\n", [(320, 340)]),
    ],
)
def test_values_are_off_where_the_file_is_off(
    text: bytes, travels: list[tuple[float, float]], limits: ac.Limits
) -> None:
    program = read_gcode(b"G21 G90\nG0 X300 Y200\n" + text, source="a", reading=Reading())
    process = Process(analog=(POWER, Analog(name="mist", rest=2.0, full=2.0, follows="coolant")))
    program, arm = prepare(program, process), ac.load_arm("pmk3s")
    trajectory = ac.plan(program, arm, limits)
    functions = analog_outputs(program, trajectory, process, limits)
    t = np.linspace(0, trajectory.duration, 3001)[1:-1]
    x = 1e3 * arm.forward(trajectory(t))[:, 0]
    travel = np.any([(x > a + 0.01) & (x < b - 0.01) for a, b in travels], axis=0)
    work = (
        (x > 310.01)
        & (x < 360)
        & ~np.any([(x > a - 0.01) & (x < b + 0.01) for a, b in travels], axis=0)
    )
    power = functions["power"](t)
    assert travel.sum() > 100 and not power[travel].any()
    assert work.sum() > 100 and (power[work] >= 0.2).all()
    mist = b"M8\n" in text
    cooled = (x > 310.01) & (x < 319.99) & mist
    np.testing.assert_array_equal(functions["mist"](t)[cooled], 2.0)
    np.testing.assert_array_equal(functions["mist"](t)[x > 320.01], 0.0)
