"""Plans: which jobs they mean, and what is wrong with them in one sentence."""

import itertools
import math

import numpy as np
import pytest

from armcontour.batches import read_plan
from armcontour.core.errors import InvalidInput

SPEED, TOLERANCE = "limits.speed", "corners.tolerance"


def values(plan):
    return [plan.values(k) for k in range(len(plan))]


def test_a_product_has_each_value_with_each_other(planned):
    plan = read_plan(planned({SPEED: ["50 mm/s", 0.1], TOLERANCE: ["1 mm", "2 mm", 3e-3]}))
    assert values(plan) == list(itertools.product([0.05, 0.1], [1e-3, 2e-3, 3e-3]))
    assert plan.units == {SPEED: "m/s", TOLERANCE: "m", "duration": "s", "corner_error": "m"} | {
        "contour_error.rms": "m",
        "contour_error.max": "m",
        "demand_ratio": "1",
    }


def test_zipped_values_go_together_and_a_single_one_with_all(planned):
    over = {SPEED: [0.05, 0.1], TOLERANCE: ["1 mm", "2 mm"], "cycle": "8 ms"}
    assert values(read_plan(planned(over, combine="zip"))) == [
        (0.05, 1e-3, 8e-3),
        (0.1, 2e-3, 8e-3),
    ]


def test_ranges_meet_their_ends_and_are_even(planned):
    over = {
        SPEED: {"from": "50 mm/s", "to": "0.25 m/s", "steps": 5},
        TOLERANCE: {"from": "0.1 mm", "to": "10 mm", "steps": 3, "scale": "log"},
        "runs.only.timing.intervals": {"from": 100, "to": 300, "steps": 3},
    }
    plan = read_plan(planned(over))
    speed, tolerance, intervals = (x.values for x in plan.parameters)
    assert speed == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.25]) and speed[-1] == 0.25
    assert tolerance == pytest.approx([1e-4, 1e-3, 1e-2], rel=1e-12)
    assert tolerance[0] == 1e-4 and tolerance[-1] == 1e-2
    assert intervals == (100, 200, 300) and all(isinstance(x, int) for x in intervals)


def test_samples_fill_ranges_evenly_and_come_again(planned):
    over = {
        SPEED: {"from": 0.05, "to": 0.25},
        TOLERANCE: {"from": "0.1 mm", "to": "10 mm", "scale": "log"},
        "cycle": "8 ms",
    }
    plan = read_plan(planned(over, combine={"sobol": 64, "seed": 1}))
    drawn = np.array(values(plan))
    assert len(plan) == 64 and set(drawn[:, 2]) == {8e-3}
    # One of 64 samples in each 64th of each range, and one in each cell of 8 times 8.
    shares = np.column_stack(
        [(drawn[:, 0] - 0.05) / 0.2, np.log(drawn[:, 1] / 1e-4) / math.log(100)]
    )
    for column in shares.T:
        assert sorted((column * 64).astype(int)) == list(range(64))
    assert len({(int(a * 8), int(b * 8)) for a, b in shares}) == 64
    again = read_plan(planned(over, combine={"sobol": 64, "seed": 1}))
    assert values(again) == values(plan)
    assert values(read_plan(planned(over, combine={"sobol": 64, "seed": 2}))) != values(plan)
    # A number that is no power of 2 is the start of the next one.
    assert values(read_plan(planned(over, combine={"sobol": 50, "seed": 1}))) == values(plan)[:50]


def test_several_jobs_have_all_values_each(planned, jobs):
    (jobs / "other.yaml").write_text((jobs / "bend.yaml").read_text().replace("0.33", "0.34"))
    data = planned({SPEED: [0.05, 0.1]})
    data["jobs"] = [data.pop("job"), str(jobs / "other.yaml")]
    plan = read_plan(data)
    assert [(plan.bases[plan.base(k)].name, *plan.values(k)) for k in range(4)] == [
        ("bend", 0.05), ("bend", 0.1), ("other", 0.05), ("other", 0.1),
    ]  # fmt: skip


def test_a_drawing_in_a_cell_is_a_job(tmp_path):
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n300,200\n330,200\n")
    data = {
        "job": {"drawing": "line.csv", "cell": "pmk3s"},
        "over": {"limits.speed": ["20 mm/s", "40 mm/s"]},
        "do": "compensate",
    }
    (tmp_path / "plan.yaml").write_text(repr(data))
    plan = read_plan(tmp_path / "plan.yaml")
    assert plan.name == "plan" and plan.bases[0].name == "line" and len(plan) == 2
    job = plan.bases[0].job(plan.data(1))
    assert job.runs[0].limits.speed == 0.04 and job.program.length == pytest.approx(0.03)


def test_keys_of_a_placement_take_values_and_its_run_is_that_of_the_plan(planned, jobs):
    placement = "placement: {over: {yaw: {from: 0 deg, to: 10 deg, places: 2}}, run: only}\n"
    (jobs / "asked.yaml").write_text((jobs / "bend.yaml").read_text() + placement)
    over = {"placement.over.yaw.to": ["20 deg", "30 deg"], "placement.objective": "manipulability"}
    plan = read_plan(planned(over) | {"job": str(jobs / "asked.yaml")})
    job = plan.bases[0].job(plan.data(1))
    assert job.placement.over["yaw"] == (0.0, pytest.approx(math.radians(30)), 2)
    assert job.placement.objective == "manipulability" and job.placement.run is None


TWO = "runs: {only: {compensation: {method: none}}, other: {compensation: {method: none}}}\n"


def test_placing_takes_the_run_that_the_placement_names(planned, jobs):
    text = (jobs / "bend.yaml").read_text().partition("runs:")[0] + TWO
    placement = "placement: {over: {x: {from: 0 mm, to: 10 mm, places: 2}}, run: other}\n"
    (jobs / "two.yaml").write_text(text + placement)
    named = {"job": str(jobs / "two.yaml"), "do": "place"}
    assert read_plan(planned() | named).bases[0].run == "other"
    assert read_plan(planned() | named | {"run": "only"}).bases[0].run == "only"
    # Which run that is, the placement decides, as with one run of the timing optimal.
    (jobs / "two.yaml").write_text(text + placement.replace(", run: other", ""))
    assert read_plan(planned() | named).bases[0].run is None


def between(first, last, steps=None, **more):
    """A range."""
    return {"from": first, "to": last, **more} | ({} if steps is None else {"steps": steps})


X = "placement.over.x"
PLACE, SOBOL = {"do": "place"}, {"combine": {"sobol": 8}}
# Further keys of the plan, its parameters, words of the message.
WRONG = [
    (PLACE, {}, ["do: place requires the key placement.over in bend.yaml"]),
    (PLACE, {"placement.objective": ["duration", "torque"]}, ["requires the key placement.over"]),
    (
        PLACE | {"columns": ["duration"]},
        {X: [{"from": 0, "to": 0.1, "places": 2}]},
        ["columns (item 1): duration requires do: compensate, but the plan has do: place"],
    ),
    (
        {"columns": ["best.place.x"]},
        {},
        ["best.place.x requires do: place, but the plan has do: run"],
    ),
    ({"ower": {}}, {}, ["the plan", "ower", "did you mean over?"]),
    ({}, {"limits.spede": [1]}, ["over.limits.spede", "did you mean speed?"]),
    ({}, {SPEED: [0.1, "5 mm"]}, ["over.limits.speed (item 2)", "m/s", "'5 mm'"]),
    ({}, {SPEED: between("1", "2 m/s", 2)}, [f"{SPEED}.from", "no unit"]),
    ({}, {SPEED: [0.1, -0.1]}, ["over.limits.speed (item 2)", "above zero"]),
    ({}, {"runs.only.timing.method": ["optimal", "fastest"]}, ["(item 2)", "fastest"]),
    ({}, {"placement.over.w.to": [1]}, ["placement.over.w"]),
    ({}, {SPEED: []}, ["over.limits.speed", "empty"]),
    ({}, {SPEED: between(0.1, 0.1, 5)}, ["empty range", "0.1"]),
    ({}, {SPEED: between(0.1, 0.2)}, ["over.limits.speed.steps is missing"]),
    ({}, {SPEED: between(0.1, 0.2, 2.5)}, ["whole number", "2.5"]),
    ({}, {SPEED: between(1, 2, step=3)}, ["'step'", "steps?"]),
    ({}, {TOLERANCE: between(0, 1, 3, scale="log")}, ["positive", "from 0"]),
    ({}, {TOLERANCE: between(1, 2, 3, scale="cubic")}, ["linear, log", "cubic"]),
    ({"combine": "zip"}, {SPEED: [1, 2], TOLERANCE: [1, 2, 3]}, [f"{SPEED} has 2", "has 3"]),
    ({}, {"corners": ["sharp"], TOLERANCE: [1]}, ["over.corners contains over.corners.tolerance"]),
    (SOBOL, {SPEED: [1]}, ["combine.sobol", "requires a range"]),
    (SOBOL, {SPEED: [1, 2]}, ["over.limits.speed", "requires a range"]),
    (SOBOL, {SPEED: between(1, 2, 3)}, ["Remove steps"]),
    ({"run": "onyl"}, {}, ["bend.yaml", "no run 'onyl'", "only"]),
    ({"job": "none.yaml"}, {}, ["no job file none.yaml"]),
    ({"jobs": ["a.yaml"]}, {}, ["either the key job", "or the key jobs"]),
    ({"columns": ["duratoin"]}, {}, ["columns (item 1)", "did you mean duration?"]),
    ({"do": "compensate", "columns": ["contour_error.rms"]}, {}, ["do: run", "has do: compensate"]),
    ({"columns": ["duration", "duration"]}, {}, ["item 2", "repeated"]),
    ({"columns": []}, {}, ["columns is empty"]),
    ({}, {"cycle.x": [1]}, ["bend.yaml", "cycle is", "no key x"]),
    ({}, {"runs.other.duration": [1]}, ["names no run of the job: the runs are only"]),
    ({}, {x: between(1, 2, 9999) for x in (SPEED, TOLERANCE)}, ["99980001 jobs"]),
    ({}, {SPEED: ["50 mm/s", 0.05]}, ["jobs 1 and 2", "are equal"]),
    ({"limits": {"time": "1 s"}}, {}, ["limits"]),
    ({}, {"arm": ["pmk3s", "none.urdf"]}, ["over.arm (item 2)", "none.urdf"]),
]


def refusal(data):
    try:
        return f"accepted: {len(read_plan(data).job_keys())} jobs"
    except InvalidInput as error:
        return str(error)


def test_wrong_plans_are_refused_in_one_sentence(planned):
    faults = []
    for more, over, words in WRONG:
        message = refusal(planned(over) | more)
        missing = [x for x in words if x not in message]
        if missing or message[-1] not in ".?)" or "\n" in message:
            faults.append((more, over, message, missing))
    assert faults == []


def test_a_key_is_that_of_the_run_if_it_has_it_itself(planned, jobs):
    text = (jobs / "bend.yaml").read_text()
    job_text = text.replace(
        "only: {", "only: {limits: {speed: 0.2 m/s}, corners: {tolerance: 2 mm}, "
    )
    (jobs / "own.yaml").write_text(job_text)
    over = {SPEED: ["80 mm/s"], TOLERANCE: [1e-4], "timing.reserve": ["2 %"]}
    plan = read_plan(planned(over) | {"job": str(jobs / "own.yaml")})
    (run,) = plan.bases[0].job(plan.data(0)).runs
    assert run.limits.speed == pytest.approx(0.08) and run.rounding.tolerance == 1e-4
    assert run.timing.reserve == pytest.approx(0.02) and plan.units["timing.reserve"] == "1"
    assert plan.data(0)["limits"]["speed"] == pytest.approx(0.1)


def test_values_that_only_go_together_are_not_refused_alone(planned):
    over = {"servo.order": ["second", "first"], "servo.kv": [150, None]}
    plan = read_plan(planned(over, combine="zip"))
    base = plan.bases[0]
    orders = [base.job(plan.data(k)).servo.order for k in range(2)]
    assert orders == ["second", "first"]
