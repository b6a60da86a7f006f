"""Work that signals may end; tests/slow/cli sends them."""

import signal

import pytest

from armcontour.cli.interrupts import run_interruptibly


def test_gives_the_exit_code_and_raises_errors():
    before = signal.getsignal(signal.SIGTERM)
    assert run_interruptibly(lambda: 3) == 3

    def broken():
        raise KeyError("broken")

    with pytest.raises(KeyError, match="broken"):
        run_interruptibly(broken)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("ignored", [True, False])
def test_an_ignored_signal_stays_ignored(ignored):
    handler = signal.SIG_IGN if ignored else signal.SIG_DFL
    before = signal.signal(signal.SIGTERM, handler)
    try:
        assert run_interruptibly(lambda: signal.getsignal(signal.SIGTERM) is handler) is ignored
    finally:
        signal.signal(signal.SIGTERM, before)
