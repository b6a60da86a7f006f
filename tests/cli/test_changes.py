"""Options of `run` make the changes that it suggests."""

import json

import pytest
import yaml

CORNERS = [[0.4, -0.05, 0.2], [0.5, -0.05, 0.2], [0.5, 0.05, 0.2], [0.4, 0.05, 0.2]]
JOB = {
    "name": "square",
    "arm": "ur5e",
    "path": {"points": [*CORNERS, CORNERS[0]], "orientation": {"axis": [0, 0, -1]}},
    "limits": {"speed": "250 mm/s"},
    "corners": {"tolerance": "0.25 mm", "continuity": "tangent"},
    "cycle": "2 ms",
    "servo": {"kp": 9.75, "kv": 28.5},
    "command_limits": {"joint_velocity": 3.14, "joint_acceleration": 9.42},
    "runs": {"only": {"timing": {"reserve": "2 %"}}},
}


def test_options_make_the_changes_that_repair_limited_set_points(tmp_path, command):
    file = tmp_path / "job.yaml"
    file.write_text(yaml.safe_dump(JOB))

    def run_with(folder, *options):
        command("run", file, "--out", tmp_path / folder, *options)
        (run,) = json.loads((tmp_path / folder / "summary.json").read_text())["runs"].values()
        return run

    result = run_with("before", "--changes")
    assert result["kept"] is False
    assert len(result["changes"]) > 1
    for k, change in enumerate(result["changes"]):
        options = [f"--set={key}={value}" for key, value in change["edits"]]
        after = run_with(f"after {k}", *options)
        assert after["kept"] is change["kept"] is True
        assert after["duration"] == pytest.approx(change["duration"], rel=1e-9)
