"""Shared fixtures: the paper's job, a check of refusals, and deterministic Hypothesis."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from loky.backend import resource_tracker as loky_tracker

import armcontour as ac
from armcontour.geometry import RoundedPath

settings.register_profile(
    "suite",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=20,
    suppress_health_check=[HealthCheck.too_slow],
)
# New examples at every run, for `make soak`; a failure prints the blob that reproduces it.
settings.register_profile(
    "soak",
    derandomize=False,
    deadline=None,
    database=None,
    max_examples=2000,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("suite")  # --hypothesis-profile chooses another one


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep modules and tests, millions of objects, out of Python's search for garbage.

    They live to the end anyway; looking through them again and again is a third of the time that
    collection takes, and a part of every test after it.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.fixture(autouse=True, scope="session")
def own_state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Drafts of the Studio are not those of the person who tests."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(autouse=True, scope="session")
def trackers() -> None:
    """Two processes clean up after other processes; they start once and run until Python ends."""
    resource_tracker.ensure_running()
    loky_tracker.ensure_running()


# Dask keeps the thread in which it packs messages until Python ends.
KEPT_THREADS = ("Dask-Offload",)
# Longest time to wait for a thread to end [s].
ENDING = 20.0


def _threads() -> set[threading.Thread]:
    return {x for x in threading.enumerate() if not x.name.startswith(KEPT_THREADS)}


def _resources() -> set[str]:
    """What is open: threads; on Linux files, sockets, pipes and child processes, too."""
    resources = {f"thread {x.name} ({x.ident})" for x in _threads()}
    # Entries end while they are read: the folder that lists them is an open file, too.
    for entry in Path("/proc/self/fd").glob("*"):
        with suppress(OSError):
            resources.add(f"file {entry.name}: {entry.readlink()}")
    for entry in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):
            # A process that has just started has not the command line yet that it will have.
            resources |= {f"process {child}" for child in entry.read_text().split()}
    return resources


@pytest.fixture(autouse=True, scope="module")
def nothing_left_open() -> Iterator[None]:
    """Fail where a module leaves something open, which another module's test would suffer from."""
    threads = _threads()
    before = _resources()
    yield
    # A thread that is being started can be joined only after its start.
    for _ in range(2):
        for thread in _threads() - threads:
            with suppress(RuntimeError):
                thread.join(ENDING)
    if _resources() - before:
        # A file or socket that is not closed causes a warning, which fails the test here.
        gc.collect()
    leaks = sorted(_resources() - before)
    assert not leaks, "Left open by the tests of this module:\n" + "\n".join(leaks)


# Paper, Sec. IV-A.
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))  # m
ASSIGNED_VELOCITY = 0.15  # m/s
CORNER_ERROR = 5e-3  # m
CENTRIPETAL_ACCELERATION = 0.09  # m/s²


@pytest.fixture(scope="session")
def arm() -> ac.PlanarTwoLink:
    return ac.load_arm("pmk3s")


@pytest.fixture(scope="session")
def objective() -> ac.Path:
    return ac.Path.polyline(POINTS)


@pytest.fixture(scope="session")
def rounded(objective: ac.Path) -> RoundedPath:
    return ac.round_corners(
        objective, tolerance=CORNER_ERROR, acceleration=CENTRIPETAL_ACCELERATION
    )


@pytest.fixture(scope="session")
def limits(arm: ac.PlanarTwoLink) -> ac.Limits:
    return arm.limits.replace(
        speed=ASSIGNED_VELOCITY, centripetal_acceleration=CENTRIPETAL_ACCELERATION
    )


@pytest.fixture(scope="session")
def servo() -> ac.ServoModel:
    return ac.ServoModel(kp=25.0, kv=150.0)


@pytest.fixture(scope="session")
def traced(rounded: RoundedPath, arm: ac.PlanarTwoLink) -> ac.JointPath:
    return ac.trace(rounded, arm)


@pytest.fixture(scope="session")
def mac(traced: ac.JointPath, arm: ac.PlanarTwoLink, limits: ac.Limits) -> ac.Trajectory:
    """The paper's job, planned by the paper's method with 600 knots a line."""
    return ac.plan(traced, arm, limits, ac.Paper(knots=600))


@pytest.fixture(scope="session")
def conventional(objective: ac.Path, arm: ac.PlanarTwoLink, limits: ac.Limits) -> ac.Trajectory:
    """The paper's job by the conventional method, at 0.04 m/s."""
    return ac.plan(objective, arm, limits.replace(speed=0.04), ac.Conventional())


@pytest.fixture(scope="session")
def refuses() -> Callable[..., None]:
    """Check that a call is refused: class, key words of the message, and its data."""

    def check(
        call: Callable[[], Any], kind: type[ac.ArmContourError], *words: str, **data: Any
    ) -> None:
        with pytest.raises(kind) as caught:
            call()
        error = caught.value
        message = str(caught.value)
        missing = [word for word in words if word not in message]
        assert not missing, f"{missing} not in {message!r}"
        assert message.endswith(".") and "\n" not in message  # one sentence for a person
        for name, expected in data.items():
            value = getattr(error, name)
            if isinstance(expected, (str, type(None))):
                assert value == expected, name
            else:
                assert np.shape(value) == np.shape(expected), name
                np.testing.assert_allclose(value, expected, rtol=1e-6, atol=1e-12, err_msg=name)

    return check


@pytest.fixture(scope="session")
def worst_ratios() -> Callable[..., dict[str, float]]:
    """Judge a plan by its law alone: every limit's largest ratio, at ends and random places.

    Values come from the law's joint positions, velocities and accelerations and from forward
    kinematics; nothing is shared with the planner's constraints.
    """

    def judge(
        planned: ac.Trajectory,
        limits: ac.Limits,
        arm: ac.Arm | None = None,
        *,
        places: int = 50,
        seed: int = 0,
    ) -> dict[str, float]:
        peaks: dict[str, float] = {}
        rng = np.random.default_rng(seed)
        for law in planned.laws:
            n = len(law.breaks) - 1
            share = np.column_stack([np.zeros(n), rng.random((n, places)), np.ones(n)])
            t = (law.breaks[:-1, None] + share * np.diff(law.breaks)[:, None]).ravel()
            i = np.repeat(np.arange(n), places + 2)
            # The last column is the break itself, not what rounding makes of it.
            t[places + 1 :: places + 2] = law.breaks[1:]
            q, dq, ddq = (law.on_interval(i, t, order) for order in (0, 1, 2))
            used: dict[str, Any] = {}
            if limits.joint_velocity is not None:
                low, high = limits.velocity_bounds(dq.shape[1])
                used["joint_velocity"] = np.maximum(dq / low, dq / high)
            if limits.joint_acceleration is not None:
                low, high = limits.acceleration_bounds(dq.shape[1])
                used["joint_acceleration"] = np.maximum(ddq / low, ddq / high)
            if arm is not None and planned.path is not None:
                velocity = arm.tool_velocity(q, dq)
                acceleration = arm.tool_acceleration(q, dq, ddq)
                speed = np.linalg.norm(velocity, axis=1)
                middle = (law.s[:-1] + law.s[1:]) / 2
                segment_speeds = planned.path.speeds[planned.path.locate(middle)][i]
                assigned = np.fmin(segment_speeds, np.inf if limits.speed is None else limits.speed)
                used["speed"] = speed / assigned
                if limits.tool_acceleration is not None:
                    used["tool_acceleration"] = (
                        np.linalg.norm(acceleration, axis=1) / limits.tool_acceleration
                    )
                if limits.centripetal_acceleration is not None:
                    moving = speed > 1e-6
                    direction = velocity[moving] / speed[moving, None]
                    along = np.sum(acceleration[moving] * direction, axis=1, keepdims=True)
                    across = np.linalg.norm(acceleration[moving] - along * direction, axis=1)
                    used["centripetal_acceleration"] = across / limits.centripetal_acceleration
            for name, ratio in used.items():
                peaks[name] = max(peaks.get(name, 0.0), float(ratio.max()))
        return peaks

    return judge
