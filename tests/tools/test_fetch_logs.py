"""Conversions of downloaded logs, on small originals of the same form."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
import fetch_logs


def test_oscilloscope_traces_become_degrees():
    traces = [
        f"Zeit[sec];Soll;Ist;Fehler\n0.0;{1e9 * j};{2e9 * j};0\n0.004;{3e9 * j};{4e9 * j};0\n"
        for j in range(1, 7)
    ]
    columns = fetch_logs.from_kuka([*traces[:5], traces[5] + "0.008;0;0;0\n"])
    scale = 1e9 * np.arange(1, 7) * fetch_logs.KUKA_UNITS
    np.testing.assert_allclose(columns[:, 0], [0, 0.004])
    np.testing.assert_allclose(columns[1, 1:], [*(3 * scale), *(4 * scale)])


def test_velocities_are_integrated_until_a_lost_packet():
    rate = "0\n1\n0\n3\n0\n5\n"
    times = "0\n0.5\n1\n"
    positions = "\n".join(map(str, range(8)))
    columns = fetch_logs.from_panda(rate, times, "10\n20\n", "0\n0.005\n0.01\n1\n", positions)
    slopes = 20 + 2 * np.array([0, 0.005, 0.01])
    expected = np.column_stack([[0, 0.005, 0.01], [10] * 3, slopes, [[0, 1], [2, 3], [4, 5]]])
    np.testing.assert_allclose(columns, expected)


def test_the_second_robot_of_an_abb_log_is_ignored():
    run = "timestamp,cmd_num,J1\n0.1,-1," + ",".join(map(str, range(12))) + "\n"
    np.testing.assert_array_equal(fetch_logs.from_abb(run), [[0.1, -1, *range(6)]])


def test_a_converted_log_is_read_back(tmp_path):
    import armcontour as ac

    table = np.column_stack([np.arange(60) * 4e-3, np.arange(240).reshape(60, 4)])
    fetch_logs.write(tmp_path / "a" / "log.csv", table, fetch_logs.joints(2, "deg"))
    log = ac.read_log(tmp_path / "a" / "log.csv")
    np.testing.assert_allclose(np.degrees(log.measured), table[:, 3:])
