"""Wrong times of logs: what is found, rebuilt, left out and refused."""

import dataclasses

import numpy as np
import pytest
from tests.files.tables import parse_log

import armcontour as ac
from armcontour.cli.check_command import check
from armcontour.cli.command_execution import execute
from armcontour.cli.commands import Check, Identify
from armcontour.cli.identify_command import identify
from armcontour.core.errors import InvalidInput
from armcontour.files.log_file import log_text
from armcontour.motion.log_times import repair_times

CYCLE = 2e-3
KP = 9.8
KV = 29.0
NOISE = 5e-6
STALL = 42e-3
TORN = np.array([300, 411, 700, 1201])


def commands(t, joints=3):
    """Smooth commands of some joints from rest [rad], (n, joints)."""
    phases = np.arange(joints) + 0.5
    frequencies = 0.45 + 0.13 * np.arange(joints)
    waves = np.sin(2 * np.pi * frequencies * t[:, None] + phases) - np.sin(phases)
    return 0.3 * waves * np.minimum(t, 1.0)[:, None]


def follow(command, waits):
    """Positions and velocities of a second-order servo with held set-points, (n, dof) each.

    - `waits`: time until the next set-point [s], (n,).
    """
    step = 5e-4
    q = command[0].copy()
    w = np.zeros_like(q)
    positions = []
    velocities = []
    for u, wait in zip(command, waits, strict=True):
        positions.append(q)
        velocities.append(w)
        for _ in range(round(wait / step)):
            middle = w + step / 2 * KV * (KP * (u - q) - w)
            acceleration = KV * (KP * (u - q - step / 2 * w) - middle)
            q = q + step * w + step**2 / 2 * acceleration
            w = w + step * acceleration
    return np.array(positions), np.array(velocities)


def recorded(joints=3, count=4000, stalls=(), seed=0):
    """A log whose set-points wait after the samples `stalls`, with even times."""
    random = np.random.default_rng(seed)
    t = np.arange(count) * CYCLE
    u = commands(t, joints)
    waits = np.full(count, CYCLE)
    waits[list(stalls)] = STALL
    q, w = follow(u, waits)
    return ac.Log(
        t=t,
        command=u,
        measured=q + random.normal(0, NOISE, q.shape),
        velocity=w + random.normal(0, 1e-4, q.shape),
        interpolation="step",
    )


def kinds(log):
    return [x.kind for x in log.findings]


@pytest.fixture(scope="module")
def good():
    return recorded()


def test_right_times_stay(good):
    """Also gaps of honest times, single jittered steps, coarse encoders and unknown velocities."""
    used = np.ones(len(good.t), dtype=bool)
    used[1000:1040] = False
    used[[500, 800, 801]] = False
    coarse = dataclasses.replace(good, measured=np.round(good.measured / 1e-4) * 1e-4)
    for log in (good, good.at(used), coarse, dataclasses.replace(good, velocity=None)):
        repaired = repair_times(log)
        assert repaired.findings == ()
        np.testing.assert_array_equal(repaired.t, log.t)
        np.testing.assert_array_equal(repaired.measured, log.measured)


@pytest.mark.parametrize("cycles", [-1, 1])
def test_torn_samples_are_named_and_left_out(good, cycles):
    torn = good.measured.copy()
    torn[TORN, :2] = good.measured[TORN + cycles, :2]
    log = dataclasses.replace(good, measured=torn, velocity=None)
    repaired = repair_times(log)
    (finding,) = repaired.findings
    assert finding.kind == "torn" and finding.repair == "left out"
    assert finding.samples.tolist() == TORN.tolist()
    np.testing.assert_allclose(finding.t, good.t[TORN])
    assert np.abs(torn - good.measured).max() > 100 * NOISE
    np.testing.assert_allclose(repaired.measured, good.measured, atol=8 * NOISE)


def test_repeated_samples_are_named_and_left_out(good):
    rows = np.arange(len(good.t))
    rows[TORN] -= 1
    repaired = repair_times(dataclasses.replace(good, measured=good.measured[rows]))
    assert kinds(repaired) == ["repeated"]
    assert repaired.findings[0].samples.tolist() == TORN.tolist()
    np.testing.assert_allclose(repaired.measured, good.measured, atol=8 * NOISE)


def test_stalls_are_rebuilt_from_velocities_and_otherwise_refused(refuses):
    stalls = np.arange(250, 3900, 170)
    log = recorded(stalls=stalls)
    repaired = repair_times(log)
    (finding,) = repaired.findings
    assert finding.kind == "stall" and finding.repair == "rebuilt"
    found = finding.samples - 1
    # Stalls at reversals, where all joints are slow, are not determined.
    assert set(found) <= set(stalls) and len(found) >= len(stalls) - 1
    assert finding.interval == pytest.approx(STALL, rel=0.01)
    assert repaired.t[-1] == pytest.approx(log.t[-1] + len(found) * (STALL - CYCLE), rel=2e-3)
    # In a stall, the command is held.
    start = repaired.t.searchsorted(log.t[stalls[0]]) + 2
    np.testing.assert_array_equal(repaired.command[start + 5], log.command[stalls[0]])
    without = dataclasses.replace(log, velocity=None)
    for call in (repair_times, ac.identify):
        refuses(lambda x=call: x(without), InvalidInput, "times", "velocities", index=found[0] + 1)
    # Velocities that a program computes from the same times do not contradict these.
    computed = np.gradient(log.measured, log.t, axis=0)
    refuses(lambda: repair_times(dataclasses.replace(log, velocity=computed)), InvalidInput)


def test_the_servo_of_a_log_with_stalls_is_that_of_the_robot():
    log = recorded(joints=1, stalls=np.arange(250, 3900, 90))
    fit = ac.identify(log, ac.ServoFit(model="second"))
    joint = fit.joints[0]
    assert [x.kind for x in fit.findings] == ["stall"]
    assert joint.kp.value == pytest.approx(KP, rel=0.05)
    assert joint.kv.value == pytest.approx(KV, rel=0.05)
    # The intervals do not contain the errors of rebuilt times.
    assert np.isnan(joint.kp.low)


def test_dropped_samples_and_a_wrong_clock_are_rebuilt_from_velocities(good):
    dropped = np.array([400, 900, 1500, 2222])
    kept = ~np.isin(np.arange(len(good.t)), dropped)
    even = dataclasses.replace(good.at(kept), t=good.t[: kept.sum()])
    repaired = repair_times(even)
    assert kinds(repaired) == ["dropped"]
    found = repaired.findings[0].samples + np.arange(len(dropped))
    assert found.tolist() == dropped.tolist()
    # The samples that were dropped are interpolated.
    np.testing.assert_allclose(repaired.t, good.t, atol=1e-9)
    np.testing.assert_allclose(repaired.command, good.command, atol=1e-4)
    with pytest.raises(InvalidInput):
        repair_times(dataclasses.replace(even, velocity=None))
    for rate in (0.98, 1.005):
        clock = dataclasses.replace(good, t=good.t / rate, interpolation="linear")
        repaired = repair_times(clock)
        assert kinds(repaired) == ["clock rate"]
        assert repaired.findings[0].rate == pytest.approx(rate, abs=4e-4)
        np.testing.assert_allclose(repaired.t, good.t, atol=5e-3)


def test_clocks_that_were_set_are_continued_by_velocities(good, refuses):
    text = log_text(good).splitlines()
    later = [x for x in text[2:] if float(x.split(",")[0]) > 4.0]
    earlier = text[: -len(later)]
    for shift, kind in ((-3.0, "clock set"), (0.2, "clock set")):
        moved = [f"{float(x.split(',')[0]) + shift:.6f},{x.split(',', 1)[1]}" for x in later]
        log = repair_times(parse_log("\n".join([*earlier, *moved])))
        assert kinds(log) == [kind]
        assert log.findings[0].samples.tolist() == [len(earlier) - 2]
        np.testing.assert_allclose(log.t, good.t, atol=3e-4)
        bare = "\n".join(",".join(x.split(",")[:7]) for x in [*earlier, *moved])
        refuses(lambda x=bare: repair_times(parse_log(x)), InvalidInput, "clock")


def test_velocities_in_another_unit_or_of_another_motion_are_not_used(good, refuses):
    degrees = dataclasses.replace(good, velocity=np.degrees(good.velocity))
    refuses(lambda: repair_times(degrees), InvalidInput, "unit")
    other = dataclasses.replace(good, velocity=np.roll(good.velocity, 700, axis=0))
    repaired = repair_times(other)
    assert repaired.velocity is None and repaired.findings == ()
    assert len(repaired.notes) == 1


@pytest.mark.parametrize(
    "title", ["dq1", "velocity 1", "measured velocity 1 [rad/s]", "velocity 1 [rad/s]"]
)
def test_velocity_columns_are_read(title):
    rows = "\n".join(f"{i * 4e-3:.3f},{i / 100},{i / 100},{i / 10}" for i in range(60))
    log = parse_log(f"t [s],command 1 [rad],measured 1 [rad],{title}\n{rows}")
    np.testing.assert_allclose(log.velocity[:, 0], np.arange(60) / 10)
    assert log.joint_names == ("joint 1",)
    again = parse_log(log_text(log))
    np.testing.assert_array_equal(again.velocity, log.velocity)


@pytest.mark.parametrize("words", ["banana", "hold", "step or linear", "steps"])
def test_unknown_interpolations_are_refused(words, refuses):
    rows = "\n".join(f"{i * 4e-3:.3f},{i / 100},{i / 100}" for i in range(60))
    text = f"t,u1,q1\n{rows}"
    call = lambda: parse_log(f"# interpolation: {words}\n{text}")  # noqa: E731
    refuses(call, InvalidInput, words, "linear", "step")
    both = f"# interpolation: step\n# interpolation: linear\n{text}"
    refuses(lambda: parse_log(both), InvalidInput, "one interpolation")


def test_commands_name_the_samples(good, tmp_path, capsys, refuses):
    torn = good.measured.copy()
    torn[TORN, :2] = good.measured[TORN + 1, :2]
    file = tmp_path / "log.csv"
    two = dataclasses.replace(
        good, command=good.command[:, :2], measured=torn[:, [0, 2]], velocity=None, joint_names=(),
        prismatic=(),
    )  # fmt: skip
    file.write_text(log_text(two))
    assert execute(check, Check(trajectory=file, arm="pmk3s")) in (0, 1, 7)
    named = f"{TORN[1] + 1} at {good.t[TORN[1]]:.4g} s"
    assert named in capsys.readouterr().out
    stalled = dataclasses.replace(
        recorded(joints=1, stalls=np.arange(250, 3900, 90)), velocity=None
    )
    with pytest.raises(InvalidInput) as caught:
        repair_times(stalled)
    index = caught.value.index
    file.write_text(log_text(stalled))
    call = lambda: execute(identify, Identify(logs=[file]))  # noqa: E731
    refuses(call, InvalidInput, f"{index + 1} at", "velocities", index=index)
