"""Which files of arms a page may name."""

import pytest

from armcontour.errors import InvalidInput
from armcontour.studio.trust import refuse_new_xacro


def test_programs_that_the_user_has_not_named_are_refused(tmp_path):
    named = [tmp_path / "a.xacro"]
    for arm in ("b.xacro", "b.yaml", "B.XACRO", {"file": "sub/a.xacro"}):
        with pytest.raises(InvalidInput, match="--trust-xacro"):
            refuse_new_xacro({"arm": arm}, tmp_path, named)
    for arm in ("a.xacro", "./a.xacro", {"file": "a.xacro"}, "ur5e", "b.urdf"):
        refuse_new_xacro({"arm": arm}, tmp_path, named)
    # Without any trust an arm's file is read as elsewhere.
    refuse_new_xacro({"arm": "b.yaml"}, tmp_path, [])
    with pytest.raises(InvalidInput, match="is a program"):
        refuse_new_xacro({"arm": "a.xacro"}, tmp_path, [])
