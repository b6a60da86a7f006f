"""Preferences in job files: the same plans as in Python, units of positions, and refusals."""

import json

import numpy as np
import pytest
from tests.planning import cells

import armcontour as ac
from armcontour.files import parse_job
from armcontour.robot import JointPreference

RAIL = {"axis": [0, 1, 0], "lower": 0, "upper": 3, "velocity": 1, "acceleration": 1, "mass": 120}


def job_text(preferences, **arm):
    """A line in front of a UR10e on a rail."""
    keys = {"name": "ur10e", "tool": {"position": [0, 0, 0.3]}, "rail": RAIL} | arm
    path = {"points": [[0.7, 0.9, 0.1], [0.7, 1.5, 0.1]], "orientation": {"axis": [0, 0, -1]}}
    return json.dumps(
        {
            "name": "line",
            "arm": keys | ({} if preferences is None else {"preferences": preferences}),
            "path": path,
            "limits": {"speed": 0.1},
            "servo": {"kp": 25, "kv": 150},
            "runs": {"one": {}},
        }
    )


LINE = ac.Path.polyline([(0.7, 0.9, 0.1), (0.7, 1.5, 0.1)]).pointing(cells.DOWN)


@pytest.mark.parametrize(
    ("keys", "values", "prefer"),
    [
        ({"hold": "1200 mm"}, {"hold": 1.2}, None),
        ({"hold": 1.2}, {"hold": 1.2}, None),
        ({"weight": 20}, {"weight": 20.0}, None),
        ({"weight": 20}, {"weight": 20.0}, "fastest"),
        ({"weight": 20}, {"weight": 20.0}, "least motion"),
        ({"range": ["110 cm", 1.3]}, {"range": (1.1, 1.3)}, None),
        ({"still": True}, {"still": True}, None),
    ],
)
def test_job_plans_like_python(keys, values, prefer):
    arm = {} if prefer is None else {"prefer": prefer}
    job = parse_job(job_text({"rail": keys}, **arm))
    # A run of the job also avoids collisions, so it may take another configuration.
    of_job = ac.plan(job.path, job.arm, job.arm.limits.replace(speed=0.1))
    rail = ac.run(job).runs["one"].trajectory(np.linspace(0.0, 6.0, 500))[:, 0]
    if "hold" in values:
        assert (rail == values["hold"]).all()
    if "still" in values:
        assert np.ptp(rail) == 0.0
    if "range" in values:
        assert values["range"][0] - 1e-9 <= rail.min() <= rail.max() <= values["range"][1] + 1e-9
    same = cells.on_rail().with_preferences({"rail": JointPreference(**values)}, prefer=prefer)
    in_python = ac.plan(LINE, same, same.limits.replace(speed=0.1))
    assert of_job.duration == pytest.approx(in_python.duration, rel=1e-9)
    for share in np.linspace(0, 1, 7):
        t = share * in_python.duration
        np.testing.assert_allclose(of_job(t), in_python(t), atol=1e-6)


def test_angles_have_units_too():
    preferences = {
        "elbow_joint": {"range": ["-150 deg", "0 deg"]},
        "wrist_3_joint": {"hold": "90 deg"},
    }
    arm = parse_job(job_text(preferences)).arm
    assert arm.chain.held == {6: pytest.approx(np.pi / 2)}
    lower, upper = arm.limits.joint_range(arm.dof)
    assert lower[3] == pytest.approx(-np.radians(150))
    assert upper[3] == 0.0


def test_positioner_of_a_cell_is_held(tmp_path):
    (tmp_path / "line.csv").write_text(
        "x [mm],y [mm],z [mm],ax,ay,az\n0,0,100,0,0,-1\n50,0,100,0,0,-1\n"
    )
    patch = {("arm", "preferences"): {"turn": {"hold": "30 deg"}, "rail": {"weight": 3}}}
    job = ac.read_job(tmp_path / "line.csv", cell="ur10e_positioner", patch=patch)
    motion = ac.run(job).runs["compensated"].trajectory
    q = motion(np.linspace(0, motion.duration, 100))
    k = job.arm.joint_names.index("turn")
    assert (q[:, k] == np.radians(30)).all()


@pytest.mark.parametrize(
    ("preferences", "arm", "key"),
    [
        ({"rails": {"hold": 1}}, {}, ("rails",)),
        ({"rail": {"hold": "30 deg"}}, {}, ("rail", "hold")),
        ({"elbow_joint": {"hold": "0.3 m"}}, {}, ("elbow_joint", "hold")),
        ({"rail": {"hold": "4 m"}}, {}, ("rail", "hold")),
        ({"rail": {"range": ["-1 m", "1 m"]}}, {}, ("rail", "range")),
        ({"rail": {"range": ["1 m"]}}, {}, ("rail", "range")),
        ({"rail": {"hold": "1 m", "still": True}}, {}, ("rail",)),
        ({"rail": {"weight": 0}}, {}, ("rail", "weight")),
        ({"rail": {"weights": 2}}, {}, ("rail", "weights")),
    ],
)
def test_wrong_preferences_are_refused_at_their_key(preferences, arm, key):
    with pytest.raises(ac.InvalidInput) as error:
        parse_job(job_text(preferences, **arm))
    assert error.value.key == ("arm", "preferences", *key)


def test_other_wrong_keys_are_refused():
    for arm in (
        {"prefer": "slowest"},
        {"rail": {**RAIL, "weight": 2}},
        {"rail": {**RAIL, "hold": 1}},
    ):
        with pytest.raises(ac.InvalidInput):
            parse_job(job_text(None, **arm))
    planar = {"name": "pmk3s", "preferences": {"joint_1": {"weight": 2}}}
    text = json.loads(job_text(None)) | {"arm": planar}
    text["path"] = {"points": [[0.3, 0.2], [0.33, 0.2]]}
    with pytest.raises(ac.InvalidInput) as error:
        parse_job(json.dumps(text))
    assert error.value.key == ("arm", "preferences")


def test_line_out_of_reach_of_a_held_rail_is_refused():
    text = json.loads(job_text({"rail": {"hold": 3}}))
    with pytest.raises(ac.Unreachable):
        ac.run(parse_job(json.dumps(text)))


@pytest.mark.parametrize("scene", [{}, {"scene": {"floor": "none"}}])
def test_clearance_of_a_cell_with_a_held_joint_is_proven_by_few_distances(scene):
    # The arm accelerates evenly along some parts of the path, where the slope of its path
    # acceleration has rounding errors only.
    corners = [[0.45, 0.2, 0.2], [0.9, 0.2, 0.2], [0.9, 2, 0.2], [0.45, 2, 0.2], [0.45, 0.2, 0.2]]
    rail = {"axis": [0, 1, 0], "lower": 0, "upper": 2.2, "velocity": 0.6, "acceleration": 0.5}
    held = {"shoulder_pan_joint": {"hold": 2.909}}
    arm = {"name": "ur10e", "tool": {"position": [0, 0, 0.15]}, "rail": rail, "preferences": held}
    keys = {
        "arm": arm,
        "path": {"points": corners, "orientation": {"axis": [0, 0, -1]}},
        "limits": {"speed": 0.2},
        "corners": {"tolerance": 0.002},
        "servo": {"kp": 25, "kv": 150},
        "runs": {"seam": {"timing": {"method": "optimal", "reserve": "10 %"}}},
    }
    run = ac.run(parse_job(json.dumps({"name": "window frame", **keys, **scene}))).runs["seam"]
    assert run.clearance.satisfied
    assert run.clearance.evaluations < 20_000
