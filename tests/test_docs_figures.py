"""Numbers of the README and of some guides are computed again."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from benchmarks import baseline
from docs.pages import run_command
from soak import hal_drives, paper_table
from tests.dynamics_extra import needs_dynamics

import armcontour as ac

ROOT = Path(__file__).parent.parent
CYCLE = 4e-3
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
# As a velocity loop that takes its command 1 ms late has them, to first order.
OTHER = SERVO.replace(kp=25.0 / 0.975, kv=150.0 * 0.975)
ARM = ac.load_arm("pmk3s")
OBJECTIVE = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)])
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=5e-3)
LIMITS = ARM.limits.replace(speed=0.15, centripetal_acceleration=0.09)
INVERSE = ac.Inverse()
# Set-points without a limit of their acceleration.
UNLIMITED = ac.Limits(joint_acceleration=np.inf)


@pytest.fixture(scope="module")
def plans():
    """Plans by their reserve."""
    return {
        x: ac.plan(ROUNDED, ARM, LIMITS, ac.Optimal(reserve=x)) for x in (0.0, 0.005, 0.02, 0.05)
    }


def executed(plan, options=INVERSE, servo=SERVO, bodies=False, arm=None):
    set_points = ac.compensate(plan, SERVO, options, cycle=CYCLE, arm=arm)
    plant = ac.RigidBodyPlant(ARM, servo) if bodies else ac.ServoPlant(ARM, servo, LIMITS)
    return ac.simulate(set_points, plant)


def errors(plan, path=ROUNDED, **how):
    """RMS and largest contour error [mm]."""
    error = ac.evaluate(executed(plan, **how), path).contour_error
    return [error.rms * 1e3, error.max * 1e3]


def numbers(text):
    """The numbers of a text, but for those of units such as 1/s."""
    return re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w./])", text.replace("1/s", ""))


def is_printed(values, texts):
    """Whether the values round to the printed ones, within one unit of the last digit."""
    for value, text in zip(values, texts, strict=True):
        digits = len(text.partition(".")[2])
        assert value == pytest.approx(float(text), abs=0.51 * 10.0**-digits), (value, text)


def page(name):
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.filterwarnings("ignore:The set-points of joint")  # the conventional motion jumps
def test_the_table_of_contour_errors_is_computed_again(plans):
    slow = ac.plan(OBJECTIVE, ARM, LIMITS.replace(speed=0.04), ac.Conventional())
    with_reserve = plans[0.02]
    full = plans[0.0]
    rows = [
        (slow, errors(slow, OBJECTIVE, options=ac.NoCompensation())),
        (with_reserve, errors(with_reserve, options=ac.NoCompensation())),
        (with_reserve, errors(with_reserve)),
        (with_reserve, errors(with_reserve, servo=OTHER)),
        (full, errors(full, servo=OTHER)),
        (with_reserve, errors(with_reserve, bodies=True)),
        (with_reserve, errors(with_reserve, bodies=True, arm=ARM, options=ac.InverseDynamics())),
    ]
    lines = [x for x in page("docs/benchmarks.md").splitlines() if re.search(r"\d s \| .* / ", x)]
    for (plan, figures), line in zip(rows, lines, strict=True):
        is_printed([plan.duration, *figures], numbers(line.split("|", 2)[2]))
    servo = next(x for x in lines if "K_v" in x).split("|")[1]
    is_printed([OTHER.kp, OTHER.kv], numbers(servo))


def test_learning_figures_in_readme_equal_output_of_example():
    printed = yaml.safe_load(page("docs/gallery/printed.yaml"))["07_learning"]
    runs = [x for x in printed.splitlines() if x.startswith("run ")]
    first, third = (numbers(runs[k])[1] for k in (0, 2))
    words = " ".join(page("README.md").split())
    stated = re.search(
        r"of ([\d.]+) mm RMS in the first run.*?of ([\d.]+) mm RMS in the third", words
    )
    assert stated.groups() == (first, third)


def test_the_table_of_unknown_gains_in_the_readme_is_computed_again():
    text = page("README.md")
    names = {}
    exec(text.split("```python\n")[1].split("```")[0], names)
    sign = np.sign(names["off"])
    assert set(np.abs(names["off"])) == {0.01}
    rows = [x for x in text.splitlines() if re.search(r"(feed-forward|preset).*mm \|.*mm \|", x)]
    assert len(rows) == 8
    for row in rows:
        servo, differ, *printed = row.strip("| ").split(" | ")
        if servo.startswith("preset"):
            assumed = ac.ServoModel.preset(servo.split("`")[1])
        else:
            feedforward = float(numbers(servo)[0]) / 100 if numbers(servo) else 0.0
            assumed = ac.ServoModel(kp=25, kv=150, velocity_feedforward=feedforward)
        # One number holds for both gains.
        shares = [float(x) / 100 for x in numbers(differ)]
        kp = assumed.kp * (1 + shares[0] * sign)
        kv = assumed.kv * (1 - shares[-1] * sign)
        robot = ac.ServoPlant(names["arm"], assumed.replace(kp=kp, kv=kv))
        for method, cell in zip((ac.NoCompensation(), ac.Inverse()), printed, strict=True):
            set_points = ac.compensate(names["planned"], assumed, method, cycle=2e-3)
            error = ac.evaluate(ac.simulate(set_points, robot), names["rounded"]).contour_error
            is_printed([error.rms * 1e3, error.max * 1e3], numbers(cell))


GASKET = ROOT / "examples" / "drawings" / "gasket.dxf"


@needs_dynamics
def test_the_estimate_at_half_the_speed_is_computed_again():
    (stated,) = re.findall(r"`--speed-factor '50 %'` leaves ([\d.]+) mm", page("README.md"))
    (repeated,) = re.findall(r"([\d.]+) mm at half speed", page("docs/guides/gains.md"))
    job = ac.read_job(GASKET, cell="ur5e", patch={("speed_factor",): 0.5})
    row = ac.run(job).runs["compensated"].to_data()["unknown_gains.max"]
    is_printed([1e3 * row.value, 1e3 * row.value], [stated, repeated])


@needs_dynamics
def test_what_limits_of_set_points_cost_in_the_guide_is_computed_again():
    words = " ".join(page("docs/guides/compensations.md").split())
    times = re.search(r"up to (\d+) times as much as .*? and (\d+) times with the measured", words)
    costs = re.search(
        r"of ([\d.]+) mm becomes ([\d.]+) mm with .*? and ([\d.]+) mm becomes ([\d.]+) mm", words
    )
    demands = re.search(r"demands (\d+) % of its limit there, instead of (\d+) %", words)
    job = ac.read_job(GASKET, cell="ur5e")
    (run,) = job.runs
    result = ac.run(job, simulate=False).runs[run.name]
    largest = job.arm.limits.joint_acceleration
    needed = []
    errors_found = []
    demanded = []
    for servo in (SERVO, job.servo):
        for options in (ac.Inverse(command_limits=UNLIMITED), INVERSE):
            points = ac.compensate(result.trajectory, servo, options, cycle=run.cycle)
            execution = ac.simulate(points, ac.ServoPlant(job.arm, servo, run.limits))
            error = ac.evaluate(execution, result.path, limits=run.limits).contour_error
            accelerations = np.abs(np.diff(points.q, 2, axis=0)) / run.cycle**2
            needed.append((accelerations / largest).max())
            errors_found.append(1e3 * error.max)
            demanded.append(100 * (execution.peak_demand / largest).max())
    is_printed(needed[::2], times.groups())
    is_printed(errors_found, costs.groups())
    is_printed([demanded[3], demanded[2]], demands.groups())


@needs_dynamics
def test_the_certificate_of_the_readme_has_the_stated_figures(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    text = page("README.md")
    commands = text.replace("\\\n", " ")
    (line,) = re.findall(r"^\.venv/bin/armcontour certify .*$", commands, re.MULTILINE)
    arguments = shlex.split(line)[1:]
    code, printed, errors = run_command([*arguments, "--json", "--out", tmp_path / "certified"])
    assert code == 0, errors
    certificate = json.loads(printed)["certificate"]
    bound = max(x["robots"]["bound"] for x in certificate["contours"])
    (stated,) = re.findall(
        r"motion of ([\d.]+) s during which the servo's contour error is at most ([\d.]+) mm.*?"
        r"takes ([\d.]+) s, a simulated robot within this range is ([\d.]+) mm off",
        " ".join(text.split()),
    )
    is_printed([certificate["duration"]], stated[:1])
    assert bound <= 1e-3 * float(stated[1])
    fastest = certificate["uncertified"]
    is_printed([fastest["duration"], 1e3 * fastest["box"]], stated[2:])


def test_readme_states_prediction_of_recorded_logs():
    logs = ROOT / "tests/control/identification/kuka_kr300"
    fit = ac.identify(ac.read_log(logs / "A.csv"))
    prediction = fit.predict(ac.read_log(logs / "B.csv"))
    share = 100 * prediction.rms / prediction.tracking_rms
    text = page("README.md")
    stated = re.findall(r"(\d+) % \(axis (\d)\)", text)
    is_printed([share[int(axis) - 1] for _, axis in stated], [x for x, _ in stated])
    without_model = [k + 1 for k, joint in enumerate(fit.joints) if not joint.written]
    (missing,) = re.findall(r"Axes (\d) and (\d) get no model", text)
    assert without_model == [int(x) for x in missing]
    assert sorted(int(axis) for _, axis in stated) == [1, 3, 4, 6]


def test_figures_without_reserve_in_guide_equal_computed_errors(plans):
    words = " ".join(page("docs/guides/compensations.md").split())
    at_full = re.search(r"error is ([\d.]+) mm RMS at the full limit", words)
    reserved = re.search(r"([\d.]+) mm with a reserve of 0\.5 %, and ([\d.]+) mm with 5 %", words)
    is_printed([errors(plans[0.0])[0]], at_full.groups())
    is_printed([errors(plans[x])[0] for x in (0.005, 0.05)], reserved.groups())
    text = words[words.index("**Without a reserve**") : words.index("- **On rigid bodies**")]
    figures = [
        *errors(plans[0.0]),
        *errors(plans[0.0], servo=OTHER),
        *(OTHER.kp, OTHER.kv),
        *errors(plans[0.0], options=ac.PolePlacement()),
        *errors(plans[0.0], servo=OTHER, options=ac.PolePlacement()),
    ]
    is_printed(figures, numbers(text))


def test_the_table_of_poles_is_computed_again(plans):
    lines = page("docs/concepts/compensation.md").splitlines()
    for line in (x for x in lines if x.startswith("| $(-")):
        pole, *printed = numbers(line.replace(")^3", ""))
        poles = [float(pole)] * 3
        options = ac.PolePlacement(poles=poles, command_limits=UNLIMITED)
        execution = executed(plans[0.0], options=options)
        error = ac.evaluate(execution, ROUNDED).contour_error
        demand = abs(execution.demand).max(axis=0)
        is_printed([*demand, error.rms * 1e3, error.max * 1e3], printed)


def test_toppra_table_in_docs_equals_measured_baseline():
    known = baseline.baselines_by_name(baseline.read(baseline.FILE))
    rows = [x for x in page("docs/start/coming_from.md").splitlines() if re.match(r"\| \d+ \|", x)]
    assert len(rows) == 3
    for row in rows:
        points, *sides = (x.strip() for x in row.strip("|").split("|"))
        line = known[f"plan/toppra/{points}"]
        for side, note, seconds in zip(sides, line.notes, (line.ours, line.theirs), strict=True):
            duration, violation = map(float, re.findall(r"[\d.]+(?:e[+-]\d+)?", note))
            expected = [duration, 100.0 * violation, 1e3 * seconds]
            is_printed(expected, re.findall(r"\d+(?:\.\d+)?", side))


BRACKET = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20), (0.40, 0.30)])
SLOW = ARM.limits.replace(speed=0.10, centripetal_acceleration=0.09)


def test_explanation_of_bracket_in_guide_equals_computed_one():
    block = page("docs/guides/optimal.md").split("```text\n")[1].split("```")[0]
    plan = ac.plan(ac.round_corners(BRACKET, tolerance=2e-3), ARM, SLOW)
    text = str(ac.explain(plan, ARM, SLOW))
    assert re.findall("[a-z]+", block) == re.findall("[a-z]+", text)
    is_printed([float(x) for x in numbers(text)], numbers(block))


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
def test_the_durations_of_the_guides_are_computed_again():
    jerk = page("docs/guides/jerk.md")
    printed = re.search(r"# ([\d.]+) s", jerk), re.search(r"stops twice and takes ([\d.]+) s", jerk)
    limits = SLOW.replace(joint_jerk=7.2)
    for match, continuity in zip(printed, ("curvature", "tangent"), strict=True):
        rounded = ac.round_corners(BRACKET, tolerance=2e-3, continuity=continuity)
        is_printed([ac.plan(rounded, ARM, limits, ac.Optimal(reserve=0.005)).duration], [match[1]])
    lines = [
        x for x in page("docs/guides/rounding.md").splitlines() if re.match(r"\| `\w+` \|.*\d", x)
    ]
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20), (0.40, 0.30), (0.30, 0.30)])
    corners = {
        "arcs": ac.round_corners(path, tolerance=2e-3),
        "smooth": ac.round_corners(path, tolerance=2e-3, continuity="curvature"),
        "sharp": path,
    }
    durations = {x.split("`")[1]: x.split("|")[3].strip() for x in lines}
    for name, rounded in corners.items():
        is_printed([ac.plan(rounded, ARM, SLOW).duration], [durations[name]])


@pytest.mark.filterwarnings("ignore:The set-points of joint")  # the conventional motion jumps
def test_the_table_of_linuxcnc_follows_from_the_law_of_its_drives():
    """That LinuxCNC follows this law is tested where it is installed."""
    assert set(paper_table.printed()) == set(paper_table.NAMES)
    assert not paper_table.differences(paper_table.figures(hal_drives.follow))


def overridden(points, factor):
    """Set-points that a controller plays at a fraction of their speed, with lines between them."""
    since = points.t - points.t[0]
    t = np.arange(np.ceil(since[-1] / factor / points.cycle) + 1) * points.cycle
    q = np.column_stack([np.interp(t * factor, since, x) for x in points.q.T])
    slow = points.trajectory.stretched(factor)
    return ac.SetPoints(
        q=q,
        cycle=points.cycle,
        trajectory=slow,
        method="none",
        start_time=points.start_time / factor,
    )


def test_effect_of_an_override_on_the_gasket_is_computed_again():
    job = ac.read_job(GASKET, cell=GASKET.with_name("laser.yaml"))
    (run,) = job.runs
    result = ac.run(job, simulate=False).runs[run.name]
    plan = result.trajectory
    plant = ac.ServoPlant(job.arm, job.servo, run.limits)

    def largest(points):
        execution = ac.simulate(points, plant)
        return 1e6 * ac.evaluate(execution, result.path, limits=run.limits).contour_error.max

    set_points = ac.compensate(plan, job.servo, cycle=run.cycle)
    reference = ac.compensate(plan, job.servo, ac.NoCompensation(), cycle=run.cycle)
    laser = plan.events[0]
    lead = laser.due - laser.t
    table = page("docs/guides/controllers/moving.md").split("the speed | 100 %")[1]
    factors = [float(x) / 100 for x in ("100", *numbers(table.splitlines()[0]))]
    assert factors == [1.0, 0.5, 0.25, 0.1]
    rows = {
        "| `set_points`, stretched": [largest(overridden(set_points, f)) for f in factors],
        "| `reference`, stretched": [largest(overridden(reference, f)) for f in factors],
        "| `set_points` with": [
            largest(ac.compensate(plan.stretched(f), job.servo, cycle=run.cycle)) for f in factors
        ],
        # The device takes the lead time, in which the plan advances by a fraction of it only.
        "| laser on": [
            1e3 * float(plan.s(laser.due) - plan.s(laser.t + f * lead)) for f in factors
        ],
    }
    for begin, values in rows.items():
        (line,) = (x for x in table.splitlines() if x.startswith(begin))
        is_printed(values, numbers(line.split("|", 2)[2]))
