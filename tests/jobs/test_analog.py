"""Analog outputs over the time of a plan, and their exports."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from tests.geometry.tables import line, path_of, refused
from tests.jobs.making import ARM

import armcontour as ac
from armcontour.files.drawings.gcode import read_gcode
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.exports import CsvFormat, TemplateFormat
from armcontour.jobs import analog_outputs
from armcontour.jobs.analog_signals import check_analog
from armcontour.program import (
    Analog,
    Contour,
    Event,
    Lead,
    Pierce,
    Process,
    Program,
    Switch,
    prepare,
)

SLOW = 0.02  # m/s, assigned to the first segment
FAST = 0.05  # m/s, limit of the tool elsewhere
LEAD = Lead(length=2e-3)
POWER = Analog(name="power", rest=0.2, full=1.0)
FLOW = Analog(name="flow", rest=0.0, full=8.0, speed=0.1, off=-1.0)
EARLY = Analog(name="early", rest=0.2, full=1.0, lead_time=0.05)
LASER = Switch(name="laser")
LIMITS = ARM.limits.replace(speed=FAST)
PROCESS = Process(lead_in=LEAD, lead_out=LEAD, switch=LASER, analog=(POWER, FLOW, EARLY))


def planned(process=PROCESS):
    drawn = path_of(line([0.30, 0.20], [0.34, 0.20], speed=SLOW), line([0.34, 0.20], [0.38, 0.20]))
    gap = Event(name="laser", value=False, s=0.01), Event(name="laser", value=True, s=0.013)
    first = Contour(path=drawn, events=gap)
    second = Contour(path=ac.Path.polyline([[0.38, 0.24], [0.30, 0.24]]))
    program = prepare(Program(moves=(first, second)), process)
    return program, ac.plan(program, ARM, LIMITS)


@pytest.fixture(scope="module")
def plan():
    return planned()


def test_analog_outputs_follow_the_speed_of_the_tool(plan):
    program, trajectory = plan
    functions = analog_outputs(program, trajectory, PROCESS, LIMITS)
    t = np.linspace(-0.1, trajectory.duration + 0.1, 4001)
    inside = (t >= 0) & (t <= trajectory.duration)
    q, dq = (trajectory(t[inside], order) for order in (0, 1))
    x, y = ARM.tool_position(q).T
    # Off in leads, in the rapid and where the contour switches the laser off; by the tool alone.
    first = (np.abs(y - 0.20) < 1e-6) & (x >= 0.30) & (x <= 0.38)
    second = (np.abs(y - 0.24) < 1e-6) & (x >= 0.30) & (x <= 0.38)
    on = (first & ~((x >= 0.31) & (x < 0.313))) | second
    assigned = np.where(first & (x < 0.34), SLOW, FAST)
    speed = np.linalg.norm(ARM.tool_velocity(q, dq), axis=1)
    power = functions["power"](t)
    np.testing.assert_array_equal(power[~inside], 0.0)
    expected = np.where(on, 0.2 + 0.8 * speed / assigned, 0.0)
    np.testing.assert_allclose(power[inside], expected, atol=1e-6)
    assert power.max() == pytest.approx(1.0, abs=1e-6) and (power <= 1.0).all()
    flow = functions["flow"](t)
    np.testing.assert_allclose(flow[inside], np.where(on, 80 * speed, -1.0), atol=1e-5)
    np.testing.assert_allclose(functions["early"](t), functions["power"](t + 0.05), atol=1e-12)
    # A whole number while off leaves all values as they are.
    whole = dataclasses.replace(PROCESS, analog=(dataclasses.replace(POWER, off=0),))
    values = analog_outputs(program, trajectory, whole, LIMITS)["power"](t)
    np.testing.assert_array_equal(values, power)


def test_outputs_are_on_while_the_tool_pierces_and_along_active_leads():
    lead = Lead(length=2e-3, active=True)
    pierce = Pierce(time=0.25)
    ends = {"lead_in": lead, "lead_out": LEAD}
    pierced = Process(**ends, pierce=pierce, switch=LASER, analog=(POWER,))
    program, trajectory = planned(pierced)
    power = analog_outputs(program, trajectory, pierced, LIMITS)["power"]
    for span in trajectory.contour_spans:
        start = span.t[0]
        begin, end = span.work
        t = np.array([start - 0.26, start - 0.24, start - 0.01, (start + begin) / 2, end + 1e-3])
        values = power(t)
        np.testing.assert_allclose(values[[0, 1, 2, 4]], [0.0, 0.2, 0.2, 0.0], atol=1e-9)
        assert values[3] > 0.2
    laser = [x.t for x in trajectory.events if x.value is True]
    assert laser[0] == pytest.approx(trajectory.contour_spans[0].t[0] - 0.25)


def test_a_layer_can_have_its_own_analog_outputs():
    heights = {"CUT": 0.20, "MARK": 0.22, "NONE": 0.24}
    lines = {k: ac.Path.polyline([[0.30, y], [0.34, y]]) for k, y in heights.items()}
    gas = Analog(name="gas", rest=3.0, full=3.0, off=1.0)
    by_layer = {"MARK": {"analog": (gas,)}, "NONE": {"analog": ()}}
    process = Process(analog=(POWER,), by_layer=by_layer)
    drawn = Program(moves=tuple(Contour(path=x, layer=k) for k, x in lines.items()))
    program = prepare(drawn, process)
    trajectory = ac.plan(program, ARM, LIMITS)
    functions = analog_outputs(program, trajectory, process, LIMITS)
    times = np.array([np.mean(x.t) for x in trajectory.contour_spans])
    np.testing.assert_allclose(functions["power"](times), [1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_array_equal(functions["gas"](times), [1.0, 3.0, 1.0])
    # A constant needs no assigned velocity.
    only = dataclasses.replace(process, analog=())
    lifted = LIMITS.replace(speed=np.inf)
    values = analog_outputs(program, trajectory, only, lifted)["gas"](times)
    np.testing.assert_array_equal(values, [1.0, 3.0, 1.0])


def test_exported_files_have_a_column_per_analog_output(plan, tmp_path):
    program, trajectory = plan
    analog = analog_outputs(program, trajectory, PROCESS, LIMITS)
    servo = ac.ServoModel(kp=25.0, kv=150.0, dead_time=0.02)
    set_points = ac.compensate(trajectory, servo, cycle=0.004)
    assert set_points.start_time < 0
    expected = np.column_stack([output(set_points.t) for output in analog.values()])
    assert expected.any(axis=0).all()
    ac.export(set_points, tmp_path / "a.csv", CsvFormat(analog=analog))
    columns = [f"analog {x.name}" for x in PROCESS.analog]
    columns_read = pd.read_csv(tmp_path / "a.csv")
    np.testing.assert_allclose(columns_read[columns], expected, rtol=0, atol=0.51e-7)
    text = "{% set keeps_times = true %}"
    text += "{% for p in points %}{{ p.analog.power|fixed(6) }}\n{% endfor %}"
    (tmp_path / "own.j2").write_text(text)
    template = TemplateFormat(template=tmp_path / "own.j2", analog=analog)
    ac.export(set_points, tmp_path / "a.txt", template)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.txt"), expected[:, 0], atol=1e-6)
    short = {"power": lambda t: t[1:]}
    form = CsvFormat(analog=short)
    refused((lambda: ac.export(set_points, tmp_path / "b.csv", form), "shape"))


def test_invalid_outputs_and_outputs_without_a_full_speed_are_refused(plan):
    lifted = LIMITS.replace(speed=np.inf)
    process = dataclasses.replace(PROCESS, analog=(FLOW,))
    assert list(analog_outputs(*plan, process, lifted)) == ["flow"]
    refused(
        (lambda: analog_outputs(*plan, PROCESS, lifted), "power", "contour 1", "limits.speed"),
        (lambda: Process(analog=(POWER, POWER)), "same name"),
        (lambda: Analog(name="x", speed=0.0), "speed", "x"),
        (lambda: Analog(name="x", full=float("nan")), "full", "x"),
    )


def test_analog_outputs_are_off_where_the_file_switches_them_off():
    text = b"G1 X310 Y200 F1200\nM8\nM3\nG1 X320\nM9\nM5\nG1 X340\nM3\nG1 X360\n"
    travels = [(320, 340)]
    program = read_gcode(b"G21 G90\nG0 X300 Y200\n" + text, source="a", options=ReadOptions())
    process = Process(analog=(POWER, Analog(name="mist", rest=2.0, full=2.0, follows="coolant")))
    program = prepare(program, process)
    trajectory = ac.plan(program, ARM, LIMITS)
    functions = analog_outputs(program, trajectory, process, LIMITS)
    t = np.linspace(0, trajectory.duration, 3001)[1:-1]
    x = 1e3 * ARM.tool_position(trajectory(t))[:, 0]

    def in_travel(gap):
        """Return where the tool is in a travel, farther than a gap from both its ends [mm]."""
        return np.any([(x > a + gap) & (x < b - gap) for a, b in travels], axis=0)

    travel = in_travel(0.01)
    near = in_travel(-0.01)
    work = (x > 310.01) & (x < 360) & ~near
    power = functions["power"](t)
    assert travel.sum() > 100 and not power[travel].any()
    assert work.sum() > 100 and (power[work] >= 0.2).all()
    cooled = (x > 310.01) & (x < 319.99)
    np.testing.assert_array_equal(functions["mist"](t)[cooled], 2.0)
    np.testing.assert_array_equal(functions["mist"](t)[x > 320.01], 0.0)


def test_analog_outputs_are_proportional_to_the_s_word_of_the_file():
    text = b"G21 G90\nG0 X300 Y200\nM3 S500\nG1 X320 F1200\nX340 S1000\nS0\nX360\n"
    drawn = read_gcode(text, source="laser.nc", options=ReadOptions())
    laser = Analog(name="laser", rest=2.0, full=10.0, full_s=1000.0)
    process = Process(analog=(laser, dataclasses.replace(laser, name="marked", full_s=None)))
    program = prepare(drawn, process)
    trajectory = ac.plan(program, ARM, LIMITS)
    functions = analog_outputs(program, trajectory, process, LIMITS)
    t = np.linspace(0, trajectory.duration, 3001)[1:-1]
    x = 1e3 * ARM.tool_position(trajectory(t))[:, 0]
    inside = np.min([abs(x - 320), abs(x - 340)], axis=0) > 0.01
    share = np.select([x < 320, x < 340], [0.5, 1.0], 0.0)[inside]
    full = functions["marked"](t)[inside]
    assert full.min() >= 2.0 and full.max() == pytest.approx(10.0)
    np.testing.assert_allclose(functions["laser"](t)[inside], share * full, rtol=1e-12)
    weak = Process(analog=(dataclasses.replace(laser, full_s=900.0),))
    bare = Program(moves=drawn.contours[:1])
    quiet = dataclasses.replace(bare.moves[0], events=())
    refused(
        (lambda: analog_outputs(program, trajectory, weak, LIMITS), "laser.nc has S up to 1000"),
        (lambda: check_analog(Program(moves=(quiet,)), weak, LIMITS), "has no S"),
    )
