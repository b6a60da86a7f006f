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


def rows(*values):
    return [f"P {x} 0.0" for x in values]


MOTION = ["M", *rows(*range(10)), "E"]


def test_a_motion_is_played_after_its_start_command_and_recorded(bench, tmp_path):
    bench.send(*MOTION)
    bench.loop(3)
    assert not bench.device.written, "nothing moves before G"
    bench.send("G")
    bench.loop(5)
    assert bench.commands == list(range(10))
    assert bench.device.calls == ["start", "finish"] and bench.events == ["D"]
    bench.feeder.record.close()
    lines = (tmp_path / "samples.txt").read_text().splitlines()
    assert lines[3] == "0.0040000000000000001,3,0,3,0,3"
    printed = [x for x in bench.out.getvalue().splitlines() if x.startswith("s")]
    assert printed[3] == "s 4 3 3.0 0.0 3.0 0.0" and len(printed) == len(lines)


def test_a_stop_is_not_played_before_the_request(bench):
    bench.send(*MOTION, "T 6", *rows(60, 61), "E", "G")
    bench.loop(2)
    bench.send("S")
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3, 4, 5, 60, 61]
    assert bench.events == ["X 6", "D"]


def test_the_earliest_stop_that_can_still_begin_is_played(bench):
    stops = []
    for k in (2, 8, 4):
        stops += [f"T {k}", *rows(10 * k), "E"]
    bench.send(*MOTION, *stops, "G")
    bench.loop(2)  # four rows are sent: 2 is too late
    bench.send("S")
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3, 40] and bench.events == ["X 4", "D"]


def test_without_a_stop_the_motion_is_played_to_its_end(bench):
    bench.send(*MOTION, "G", "S")
    bench.loop(5)
    assert bench.commands == list(range(10)) and bench.events == ["D"]


@pytest.mark.parametrize("how", ["sender", "reader", "quit"])
def test_a_lost_connection_or_a_quit_plays_the_next_stop(bench, how):
    bench.send(*MOTION, "T 6", *rows(60), "E", "G")
    bench.loop()
    if how == "quit":
        bench.send("Q")
    else:
        getattr(bench.feeder, f"lose_{how}")()
    bench.loop(4)
    assert bench.commands == [0, 1, 2, 3, 4, 5, 60]
    assert bench.feeder.quitting and not bench.feeder.playing
    assert bench.events == {"quit": ["X 6", "D"], "sender": ["V", "X 6", "D"], "reader": []}[how]
    if how == "reader":
        bench.feeder.out.close()


def test_interrupted_motion_stops_at_last_stop_sent(bench):
    bench.send(*MOTION, "T 4", *rows(40), "E", "T 6", *rows(60, 61, 62), "E", "G")
    bench.loop(5)
    assert bench.commands == [0, 1, 2, 3, 4, 5, 60, 61, 62]
    assert bench.events == ["A", "X 6", "D"]


def test_a_stop_applies_to_one_motion_only(bench):
    bench.send(*MOTION, "T 6", *rows(60), "E", "T 10", *rows(9), "E", "G")
    bench.loop(5)
    bench.send("M", *rows(1, 2, 3), "E", "G", "S")
    bench.loop(2)
    assert bench.commands[10:] == [1, 2, 3] and bench.events == ["D", "D"]


def test_second_stop_request_does_not_replace_first_stop(bench):
    bench.send(*MOTION, "T 4", *rows(40, 41, 42, 43, 44), "E", "G", "S")
    bench.loop(2)
    bench.send("T 7", *rows(70), "E", "S")
    bench.feeder.lose_sender()
    bench.loop(5)
    assert bench.commands == [0, 1, 2, 3, 40, 41, 42, 43, 44]
    bench.send(*MOTION, "T 2", *rows(20), "E", "G", "S")
    bench.loop(2)
    assert bench.commands[9:] == [0, 1, 20]


def test_rows_after_a_missing_one_are_not_sent_and_the_motion_ends(bench):
    bench.send(*MOTION, "T 8", *rows(80), "E", "G")
    bench.loop(2)
    bench.device.end = 3  # The controller had no row for cycle 3.
    bench.send("T 9", *rows(90), "E", "S")
    bench.loop(3)
    assert bench.commands == [0, 1, 2, 3]
    assert bench.events == ["U 3", "D"] and not bench.feeder.playing


def test_a_controller_gets_the_limits_of_the_motion_and_of_each_stop(bench):
    bench.send(*MOTION, "T 6", *rows(60, 61), "E", "G")
    assert bench.device.limits == [([*range(10)], True), ([4, 5, 60, 61], False)]
    bench.send("T 8", *rows(80), "E")
    assert bench.device.limits[2:] == [([6, 7, 80], False)]
    assert "L 1.5" in bench.out.getvalue().splitlines()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_record_that_cannot_be_written_stops_the_motion_on_its_path(bench):
    bench.feeder.record.file = "/dev/full"
    bench.send(*MOTION, "T 6", *rows(60), "E", "G")
    bench.loop(5)
    assert bench.commands == [0, 1, 2, 3, 4, 5, 60]
    assert [x[0] for x in bench.events] == ["N", "X", "D"] and "space" in bench.events[0]
    samples = [x for x in bench.out.getvalue().splitlines() if x.startswith("s")]
    assert len(samples) == 7, "the sender gets all samples"
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
