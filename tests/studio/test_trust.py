"""Which files of arms a page may name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from armcontour.errors import InvalidInput
from armcontour.studio.trust import refuse_new_xacro


@pytest.mark.parametrize("arm", ["b.xacro", "b.yaml", "B.XACRO", {"file": "sub/a.xacro"}])
def test_programs_that_the_user_has_not_named_are_refused(tmp_path: Path, arm: Any) -> None:
    with pytest.raises(InvalidInput, match="--trust-xacro"):
        refuse_new_xacro({"arm": arm}, tmp_path, [tmp_path / "a.xacro"])


@pytest.mark.parametrize("arm", ["a.xacro", "./a.xacro", {"file": "a.xacro"}, "ur5e", "b.urdf"])
def test_programs_that_the_user_has_named_are_not(tmp_path: Path, arm: Any) -> None:
    refuse_new_xacro({"arm": arm}, tmp_path, [tmp_path / "a.xacro"])


def test_without_any_trust_an_arm_file_is_read_as_elsewhere(tmp_path: Path) -> None:
    refuse_new_xacro({"arm": "b.yaml"}, tmp_path, [])
    with pytest.raises(InvalidInput, match="is a program"):
        refuse_new_xacro({"arm": "a.xacro"}, tmp_path, [])
