"""Every public function says in one sentence that it got another object than it takes."""

import inspect

import numpy as np
import pytest

import armcontour as ac
from armcontour.cli.running import built_in_job

OTHERS = (None, "text", 3.5, [1, 2], {"a": 1}, np.zeros((2, 2)), object())
# Objects among them that are right.
TAKEN = {
    ("export", "file"): str, ("export", "name"): str, ("write_report", "file"): str,
    ("Payload", "mass"): float, ("Process", "layers"): dict,
}  # fmt: skip


@pytest.fixture(scope="module")
def planned(objective, arm, limits):
    return ac.plan(ac.round_corners(objective, tolerance=5e-3), arm, limits)


def refused(function, *args, **options):
    """What a call says that is refused; empty if it is not."""
    try:
        function(*args, **options)
    except ac.ArmContourError as error:
        return str(error)
    return ""


def test_other_objects_are_refused_in_one_sentence(
    objective, arm, limits, servo, conventional, planned, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    taught = ac.compensate(conventional, servo, method="none")
    plant, job = ac.ServoPlant(arm, servo, limits), built_in_job()
    parts = dict.fromkeys("lead_in lead_out switch tabs weave".split())
    parts |= {"events": (), "analog": (), "off_between": (), "by_layer": {}, "layers": {}}
    # Each argument of a call but tolerances is replaced by other objects.
    calls = [
        (ac.round_corners, (objective,), {"tolerance": 1e-3}),
        (ac.smooth_curvature, (objective,), {"tolerance": 1e-5}),
        (ac.plan, (objective, arm), {"limits": limits}),
        (ac.shape, (objective, arm), {"limits": limits, "tolerance": 1e-3}),
        (ac.compensate, (conventional, servo), {"arm": arm, "limits": limits}),
        (ac.execute, (taught, plant), {}),
        (ac.evaluate, (None, objective), {"limits": limits}),
        (ac.explain, (planned, arm), {"limits": limits}),
        (ac.check, (planned, arm), {"limits": limits}),
        (ac.export, (taught, "a.csv"), {"arm": arm, "name": "a", "outputs": {}}),
        (ac.prepare, (objective, ac.Process()), {}),
        *((x, (job,), {}) for x in (ac.run, ac.certify, ac.sweep, ac.place)),
        (ac.read_job, ("a.yaml",), {}),
        (ac.read_log, ("a.csv",), {}),
        (ac.write_report, (None, "a.html"), {}),
        (ac.check_clearance, (planned, arm), {"scene": ac.Scene()}),
        (ac.ServoPlant, (arm, servo), {"limits": limits}),
        (ac.RigidBodyPlant, (arm, servo), {}),
        (ac.Contour, (), {"path": objective, "events": ()}),
        (ac.Program, (), {"moves": (ac.Contour(path=objective),)}),
        (ac.Process, (), parts),
        (ac.Payload, (), {"mass": 1.0, "center": (0.0, 0.0, 0.0)}),
    ]
    for function, args, options in calls:
        signature = inspect.signature(function)
        given = signature.bind(*args, **options).arguments
        for slot in sorted(given.keys() - {"tolerance"}):
            default = signature.parameters[slot].default
            taken = TAKEN.get((function.__name__, slot), ())
            for other in (x for x in OTHERS if x is not default and not isinstance(x, taken)):
                said = refused(function, **given | {slot: other})
                assert said.endswith(".") and "\n" not in said, (function, slot, other, said)
    assert not list(tmp_path.iterdir())


# Values that are no numbers. Not-a-number itself goes through functions of arrays, as in numpy.
NO_NUMBERS = (
    *("a", None, 1 + 2j, object(), {}, ["a", "b"], [[1.0], [2.0, 3.0]], True, b"a"),
    *(np.zeros(2, complex), np.array(["2020-01-01"], "M8[D]"), 10**400),
    *([None, 0.1], np.array(["1", 2.0], object), np.array([True, 0.1], object)),
)
# Arrays of no state of an arm with two or six joints.
NO_STATES = ([], [1.0, 2.0, 3.0], np.zeros((2, 3, 4)), 0.5)


def test_functions_of_numbers_refuse_what_is_none_in_one_sentence(
    planned, servo, rounded, arm, traced
):
    space, states = ac.load_arm("ur5e"), (*NO_NUMBERS, *NO_STATES)
    plain = (rounded, rounded.locate, traced, traced.locate, planned, planned.motion, planned.s)
    plain += (planned.with_rests, planned.motion_with_rests, planned.time_at, planned.speed_at)
    functions = [(x, 1, NO_NUMBERS) for x in (*plain, planned.sample)]
    functions += [(rounded.project, 1, (*NO_NUMBERS, *NO_STATES)), (servo.command, 3, NO_NUMBERS)]
    functions.append((arm.inverse, 1, (*NO_NUMBERS, *NO_STATES)))
    for x in (arm, space):
        functions += [(f, 1, states) for f in (x.forward, x.jacobian, x.links)]
        functions += [(f, 2, states) for f in (x.jacobian_rate, x.tool_velocity)]
        functions += [(f, 3, states) for f in (x.tool_acceleration, x.tool_motion, x.torque)]
        functions.append((x.tool_jerk, 4, states))
    functions += [(arm.joint_velocity, 2, states), (arm.joint_acceleration, 3, states)]
    functions += [(space.pose, 1, states), (space.tool_twist_rate, 3, states)]
    for function, count, wrong in functions:
        dof = 6 if getattr(function, "__self__", None) is space else 2
        right = np.full(dof, 0.3) if wrong is states or count == 3 else 0.1
        for slot in range(count):
            for other in wrong:
                given = [right] * count
                given[slot] = other
                said = refused(function, *given)
                assert said.endswith(".") and "\n" not in said, (function, slot, other, said)


def test_orders_sides_words_and_intervals_are_refused(planned, rounded, traced, refuses):
    cases = [
        (lambda curve=curve, order=order: curve(0.0, order))
        for order in ("a", None, 0.5, -1, True, [1], np.zeros(2), 10**400)
        for curve in (rounded, traced, planned)
    ]
    cases.append(lambda: rounded(0.0, side=np.zeros((2, 2))))
    cases.append(lambda: ac.ServoModel(kp=1.0, kv=2.0, order=np.zeros(2)))
    # A joint path needs an interval for each arc length: compiled code would read past the end.
    cases += [lambda i=i: traced.motion(i, [0.1]) for i in ([], [0, 1], [10**9], [-1])]
    for call in cases:
        refuses(call, ac.InvalidInput)
    assert rounded(0.0, np.int64(1)).shape == (2,)
    assert traced.motion([0], [0.0])[0].shape == (1, 2)
    assert traced.motion([], [])[0].shape == (0, 2)


def test_parts_of_arms_are_of_their_class(arm, refuses):
    space = ac.load_arm("ur5e")
    makers = (
        arm.with_limits,
        arm.with_shapes,
        lambda x: arm.with_dynamics(payload=x),
        space.with_tool,
        space.with_work,
        lambda x: ac.SerialArm(name="a", chain=x, limits=space.limits),
        lambda x: ac.SerialArm(name="a", chain=space.chain, limits=x),
        lambda x: ac.PlanarTwoLink(name="a", base=0, links=(1, 1), limits=x),
        lambda x: ac.Scene(obstacles=x),
    )
    for make in makers:
        for other in (3.5, "text", [1.0]):
            refuses(lambda make=make, other=other: make(other), ac.InvalidInput)
