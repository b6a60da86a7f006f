"""The error tree: what a program can rely on."""

import armcontour as ac
from armcontour import errors

KINDS = (ac.InvalidInput, ac.Unreachable, ac.NotRealizable, ac.CompensationError, ac.ExecutionError)


def test_the_tree():
    assert [kind.exit_code for kind in (ac.ArmContourError, *KINDS)] == [1, 2, 3, 4, 5, 6]
    assert [issubclass(kind, ValueError) for kind in KINDS] == [True] + [False] * 4
    assert all(issubclass(kind, ac.ArmContourError) for kind in KINDS)
    own = [x for x in vars(errors).values() if isinstance(x, type)]
    assert {x.__name__ for x in own if issubclass(x, ac.ArmContourError)} <= set(ac.__all__)


def test_errors_carry_data():
    data = {"index": 3, "s": 0.5, "t": 2.0, "joint": 1, "limit": "speed", "needed": 2.0}
    for kind in KINDS:
        error = kind("It is so.", point=[1, 2], allowed=1.0, **data)
        assert str(error) == "It is so."
        assert error.point == (1.0, 2.0) and error.allowed == 1.0
        assert {name: getattr(error, name) for name in data} == data
        assert {getattr(kind("No."), name) for name in (*data, "point", "allowed")} == {None}


def test_a_sentence_writes_no_orders_to_a_terminal_and_does_not_repeat_a_file():
    error = ac.InvalidInput("no key '\x1b]52;c;cHduZWQ=\x1b\\' in \u202egpj.exe\nline\x85\ud800")
    assert str(error).isprintable()
    assert "\\x1b]52;" in str(error) and "\\u202e" in str(error) and "\\n" in str(error)
    assert str(ac.InvalidInput(str(error))) == str(error)
    assert str(ac.InvalidInput("größer als µ, 名前")) == "größer als µ, 名前"
    message = str(ac.InvalidInput("unknown key " + "x" * 1_000_000 + ": the keys are a, b."))
    assert len(message) <= 2000
    assert message.startswith("unknown key xx") and message.endswith("xx: the keys are a, b.")
