"""Identification of a job by all that its results depend on."""

import pytest

from armcontour.batches import read_plan


def digests(plan):
    return read_plan(plan).job_keys()


def test_units_and_places_of_values_do_not_matter(planned, jobs):
    first = digests(planned({"limits.speed": ["80 mm/s", "0.1 m/s"], "corners.tolerance": "1 mm"}))
    assert first == digests(planned({"limits.speed": [0.08, "100 mm/s"]}))
    text = (jobs / "bend.yaml").read_text()
    (jobs / "slow.yaml").write_text(text.replace("speed: 0.1 m/s", "speed: 0.08"))
    # The same name, as the name of a job is part of it.
    assert first[0] == digests(planned() | {"job": str(jobs / "slow.yaml")})[0]
    assert first[1] == digests(planned())[0]


def test_the_figures_and_the_version_matter(planned, monkeypatch):
    over = {"limits.speed": [0.08]}
    digests_of_plans = {
        digests(planned(over, **x))[0]
        for x in ({}, {"do": "compensate"}, {"columns": ["duration"]}, {"columns": ["length"]})
    }
    assert len(digests_of_plans) == 4
    # The name of the plan does not.
    before = digests(planned(over))
    assert digests(planned(over, name="x")) == before
    monkeypatch.setattr("armcontour.batches.base_job.__version__", "9.9.9")
    assert digests(planned(over)) != before


def test_the_files_of_a_job_matter(tmp_path):
    (tmp_path / "part.nc").write_text("G21 G90 F3000\nG0 X300 Y200\nG1 X330\nM30\n")
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n300,200\n330,200\n")
    plan = {
        "job": {"drawing": str(tmp_path / "part.nc"), "cell": "pmk3s"},
        "do": "compensate",
        "over": {"path.file": [str(tmp_path / "part.nc"), str(tmp_path / "line.csv")]},
    }
    before = digests(plan)
    (tmp_path / "line.csv").write_text("x [mm],y [mm]\n300,200\n331,200\n")
    after = digests(plan)
    assert before[0] == after[0] and before[1] != after[1]


ARM = """<robot name="stick" {more}>{include}
<link name="l0"/>{links}{joints}</robot>"""
BALL = '<collision><geometry><mesh filename="end.obj"/></geometry></collision>'
CORNERS = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 {height}\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def arm_text(*, ends="", include="", more=""):
    """A description of six joints; the last link has what is given."""
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.1 0 0.2"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" velocity="2" effort="0"/></joint>'
        for k, axis in enumerate(["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"])
    )
    links = (
        "".join(f'<link name="l{k}"/>' for k in range(1, 6)) + f'<link name="tool0">{ends}</link>'
    )
    return ARM.format(more=more, include=include, links=links, joints=joints).replace(
        '"l6"', '"tool0"'
    )


def plan_on(folder, arm):
    """A plan of one job on an arm."""
    (folder / "line.yaml").write_text(
        f"{{name: line, arm: {arm}, path: {{points: [[0.5, 0, 0.5], [0.5, 0.1, 0.5]]}}, limits: "
        "{joint_acceleration: 5}, servo: {kp: 25, kv: 150}, runs: {only: {}}}"
    )
    over = {"cycle": ["4 ms"]}
    return {"job": str(folder / "line.yaml"), "do": "compensate", "over": over}


def test_meshes_of_the_arm_matter(tmp_path):
    (tmp_path / "arm.urdf").write_text(arm_text(ends=BALL))
    (tmp_path / "end.obj").write_text(CORNERS.format(height=0.1))
    plan = plan_on(tmp_path, "arm.urdf")
    before = digests(plan)
    assert digests(plan) == before
    (tmp_path / "end.obj").write_text(CORNERS.format(height=0.2))
    assert digests(plan) != before


def test_runs_that_are_left_out_do_not_matter(planned, jobs):
    text = (jobs / "bend.yaml").read_text()
    more = text.replace("runs: {", "runs: {other: {compensation: {method: inverse}}, ")
    (jobs / "more.yaml").write_text(more)
    data = {"job": str(jobs / "more.yaml"), "run": "only"}
    assert digests(planned() | data) == digests(planned())
    with pytest.raises(Exception, match="several runs. Choose one of other, only"):
        read_plan(planned() | {"job": data["job"]})
