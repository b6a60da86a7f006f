"""Previews in a thread, and other work in a process."""

from collections.abc import Iterator
from threading import Event

from armcontour.errors import Unreachable
from armcontour.studio.lanes import FastLane
from armcontour.studio.wire import Frame


def test_of_works_that_wait_only_the_latest_is_done():
    begun, go, done = Event(), Event(), Event()
    found = []

    def deliver(frame: Frame) -> None:
        found.append(frame.header["n"])
        if frame.header["n"] == 4:
            done.set()

    def first(stale) -> Iterator[Frame]:
        assert not stale()
        begun.set()
        go.wait(5)
        assert stale()
        yield Frame("picture", {"n": 1})

    def other(n):
        def work(stale):
            assert not stale()
            yield Frame("picture", {"n": n})

        return work

    lane = FastLane(deliver)
    lane.submit(first)
    assert begun.wait(5)
    for n in (2, 3, 4):
        lane.submit(other(n))
    go.set()
    assert done.wait(5)
    lane.close()
    assert found == [1, 4]


def test_errors_are_told_and_the_lane_goes_on():
    done = Event()
    found = []

    def deliver(frame: Frame) -> None:
        found.append(frame.header["sentence"])
        done.set()

    def refused(stale) -> Iterator[Frame]:
        raise Unreachable("The arm does not reach it.")
        yield

    def wrong(stale) -> Iterator[Frame]:
        raise ZeroDivisionError("division by zero")
        yield

    lane = FastLane(deliver)
    for work in (refused, wrong):
        done.clear()
        lane.submit(work)
        assert done.wait(5)
    lane.close()
    assert found == [
        "The arm does not reach it.",
        "The preview failed: ZeroDivisionError: division by zero",
    ]
