"""Stored results of an earlier commit are compared under their present names."""

from tools.freeze import differences, renamed

NAMES = {"taught": "set_points", "--taught": "--set-points", "mac": "paper"}


def test_renamed_names_are_replaced_only_as_whole_words():
    old = {"taught": [{"method": "mac", "taught_again": 1.0}], "files": {"taught/a.csv": "macro"}}
    new = {
        "set_points": [{"method": "paper", "taught_again": 1.0}],
        "files": {"set_points/a.csv": "macro"},
    }
    assert renamed(old, NAMES) == new
    assert list(differences(renamed(old, NAMES), new)) == []
    assert len(list(differences(old, new))) > 0
    assert renamed("check out/taught.csv --taught x", NAMES) == (
        "check out/set_points.csv --set-points x"
    )


def test_rows_with_names_are_compared_by_their_names():
    first = {"name": "speed", "ratio": 0.5}
    second = {"name": "joint_jerk", "ratio": 0.9}
    assert list(differences([first, second], [second, first])) == []
    (changed,) = differences([first, second], [second, {**first, "ratio": 0.6}])
    assert changed.startswith("/speed/ratio")
    assert len(list(differences([first, first], [first, second]))) > 0
