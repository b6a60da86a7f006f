"""Commands and events of a feeder, with a simulated device and without a clock."""

import io
import os

import pytest

from armcontour.controllers.feeders.feeder import DeviceError, Feeder, Record


class Device:
    """Takes `at_once` rows per loop, and measures the commands of the loop before."""

    def __init__(self, at_once=2):
        self.at_once = at_once
        self.written = []
        self.calls = []
        self.new = []
        self.limits = []
        self.end = None

    def start(self):
        self.calls.append("start")

    def take_limits(self, rows, new):
        self.limits.append(([row[0] for row in rows], new))
        return 1.5

    def missed(self, all_sent):
        return self.end

    def room(self):
        return self.at_once

    def write(self, k, row):
        self.written.append((k, row))
        self.new.append((len(self.written), k, row, row))

    def is_done(self):
        return True

    def exchange(self):
        new = self.new
        self.new = []
        return new

    def finish(self):
        self.calls.append("finish")


class Bench:
    """A feeder without processes."""

    def __init__(self, record, **device):
        self.device = Device(**device)
        self.out = io.StringIO()
        self.feeder = Feeder(self.device, Record(str(record), 1e-3), self.out)

    def send(self, *lines):
        self.feeder.take("".join(f"{x}\n" for x in lines).encode())

    def loop(self, times=1):
        for _ in range(times):
            self.feeder.feed()
            self.feeder.report()

    @property
    def events(self):
        return [x for x in self.out.getvalue().splitlines() if x[0] not in "sL"]

    @property
    def commands(self):
        return [row[0] for _, row in self.device.written]


@pytest.fixture
def bench(tmp_path):
    made = Bench(tmp_path / "samples.txt")
    yield made
    made.feeder.record.close()


def block(number, k, more, *values):
    """Lines of a block of rows that begins at cycle k."""
    return [f"C {number} {k} {more}", *(f"P {x} 0.0" for x in values), "E"]


# A motion of ten rows, after which it ends, or another block can follow.
MOTION = ["M", *block(1, 0, 0, *range(10))]
OPEN = ["M", *block(1, 0, 1, *range(10))]


def test_a_motion_is_played_after_its_start_command_and_recorded(bench, tmp_path):
    bench.send(*MOTION)
    bench.loop(3)
    assert not bench.device.written, "nothing moves before G"
    bench.send("G")
    bench.loop(5)
    assert bench.commands == list(range(10))
    assert bench.device.calls == ["start", "finish"] and bench.events == ["K 1", "D"]
    bench.feeder.record.close()
    lines = (tmp_path / "samples.txt").read_text().splitlines()
    assert lines[3] == "0.0040000000000000001,3,0,3,0,3"
    printed = [x for x in bench.out.getvalue().splitlines() if x.startswith("s")]
    assert printed[3] == "s 4 3 3.0 0.0 3.0 0.0" and len(printed) == len(lines)


def test_a_block_replaces_the_rows_from_its_first_cycle_on(bench):
    bench.send(*OPEN, "G")
    bench.loop(2)
    bench.send(*block(2, 6, 0, 60, 61))
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3, 4, 5, 60, 61]
    assert bench.events == ["K 1", "K 2", "D"]


def test_a_block_whose_first_row_was_sent_is_refused_and_the_motion_goes_on(bench):
    bench.send(*OPEN, "G")
    bench.loop(2)  # four rows are sent
    bench.send(*block(2, 3, 0, 30), *block(3, 4, 0, 40))
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3, 40]
    assert bench.events == ["K 1", "B 2", "K 3", "D"]


def test_the_last_row_is_held_until_the_next_block(bench):
    bench.send(*OPEN, "G")
    bench.loop(8)
    assert bench.commands == [*range(10), *[9] * 6] and bench.feeder.playing
    bench.send(*block(2, 20, 0, 90))
    bench.loop(4)
    assert bench.commands == [*range(10), *[9] * 10, 90]
    assert bench.events == ["K 1", "K 2", "D"]


@pytest.mark.parametrize("how", ["sender", "reader", "quit", "end"])
def test_a_lost_connection_or_a_quit_ends_the_motion_with_its_rows(bench, how):
    bench.send(*OPEN, "G")
    bench.loop()
    if how == "quit":
        bench.send("Q")
    elif how == "end":
        bench.send("S")
    else:
        getattr(bench.feeder, f"lose_{how}")()
    bench.send(*block(2, 6, 1, 60))
    bench.loop(6)
    assert bench.commands == list(range(10)), "later blocks are refused"
    assert bench.feeder.quitting == (how != "end") and not bench.feeder.playing
    last = ["B 2", "D"]
    assert bench.events == ["K 1", *({"sender": ["V", *last], "reader": []}.get(how, last))]
    if how == "reader":
        bench.feeder.out.close()


def test_a_motion_pays_no_attention_to_the_one_before(bench):
    bench.send(*MOTION, "G")
    bench.loop(6)
    bench.send("M", *block(2, 0, 1, 1, 2, 3), "G", *block(3, 2, 0, 8))
    bench.loop(3)
    assert bench.commands[10:] == [1, 2, 8]
    assert bench.events == ["K 1", "D", "K 2", "K 3", "D"]


def test_rows_after_a_missing_one_are_not_sent_and_the_motion_ends(bench):
    bench.send(*OPEN, "G")
    bench.loop(2)
    bench.device.end = 3  # The controller had no row for cycle 3.
    bench.loop()
    bench.send(*block(2, 9, 0, 90))
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3]
    assert bench.events == ["K 1", "U 3", "D", "B 2"] and not bench.feeder.playing


def test_a_controller_gets_the_limits_of_the_motion_and_of_each_block(bench):
    bench.send(*OPEN, "G")
    assert bench.device.limits == [([*range(10)], True)]
    bench.send(*block(2, 6, 1, 60, 61))
    assert bench.device.limits[1:] == [([4, 5, 60, 61], False)]
    assert "L 1.5" in bench.out.getvalue().splitlines()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_record_that_cannot_be_written_stops_the_motion_on_its_path(bench):
    bench.feeder.record.file = "/dev/full"
    bench.send(*OPEN, "G")
    bench.loop(6)
    assert bench.commands == list(range(10))
    assert [x[0] for x in bench.events] == ["K", "N", "D"] and "space" in bench.events[1]
    samples = [x for x in bench.out.getvalue().splitlines() if x.startswith("s")]
    assert len(samples) == 10, "the sender gets all samples"
    with pytest.raises(DeviceError, match="space"):
        bench.send(*MOTION, "G")


def test_a_record_has_whole_lines_after_an_error_of_the_disk(tmp_path, monkeypatch):
    file = tmp_path / "record.csv"
    record = Record(str(file), 1e-3)
    record.begun = True
    record.add((1, 0, (0.5,), (0.25,)))
    record.write(at_once=True)
    whole = file.read_text()
    write = os.write

    def write_some(descriptor, data):
        if len(data) < 20:
            raise OSError(28, "No space left on device")
        return write(descriptor, data[:20])

    monkeypatch.setattr(os, "write", write_some)
    record.add((2, 1, (0.5,), (0.25,)))
    record.write(at_once=True)
    record.close()
    assert file.read_text() == whole == "0.001,0.5,0.25,0\n"
    assert record.error == "No space left on device"
