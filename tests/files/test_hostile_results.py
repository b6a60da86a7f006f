"""Result folders and tables of touches that are meant to stop the program: one sentence each."""

import hashlib
import json

import pytest

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files.stop_file import read_stopped_place
from armcontour.files.touch_file import read_touches
from armcontour.files.trajectory_file import read_run


@pytest.mark.parametrize("read", [read_stopped_place, read_run])
def test_deeply_nested_summaries_are_refused(read, tmp_path):
    content = "[" * 100_000
    (tmp_path / "summary.json").write_text(content)
    checksum = hashlib.sha256(content.encode()).hexdigest()
    manifest = {"armcontour": "0", "kind": "", "files": {"summary.json": checksum}}
    (tmp_path / ".armcontour.json").write_text(json.dumps(manifest))
    with pytest.raises(InvalidInput, match="summary.json is not the summary"):
        read(tmp_path)


def test_touches_have_a_limit(tmp_path):
    arm = ac.load_arm("ur5e")
    titles = ",".join(f"q{k} [deg]" for k in range(1, 7))
    file = tmp_path / "touches.csv"
    rows = ["1,2,3,4,5,6"] * 2001
    file.write_text("\n".join([titles, *rows[:2000]]))
    assert len(read_touches(file, arm).q) == 2000
    file.write_text("\n".join([titles, *rows]))
    with pytest.raises(InvalidInput, match="2001 touches, but at most 2000"):
        read_touches(file, arm)
