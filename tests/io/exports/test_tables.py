"""CSV, Parquet and npz, read back by pandas, pyarrow and numpy."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from armcontour.io import read_trajectory
from armcontour.io.exports import Table, write_table
from armcontour.io.exports.text import event_data

EVENT = re.compile(r'(?P<name>\w+)=(?P<value>on|off|[-\d.e]+|"(?:[^"\\]|\\.)*")@(?P<t>[\d.]+)')
QUANTITIES = (("q", "rad"), ("dq", "rad/s"), ("ddq", "rad/s^2"))


def assert_columns(found: pd.DataFrame, table: Table, atol: float) -> None:
    np.testing.assert_allclose(found["t [s]"], table.t, rtol=0, atol=atol)
    for quantity, unit in QUANTITIES:
        for i, name in enumerate(table.joint_names):
            values = found[f"{quantity} {name} [{unit}]"]
            np.testing.assert_allclose(
                values, getattr(table, quantity)[:, i], rtol=0, atol=atol, err_msg=name
            )


def events_in(cell: str) -> list[tuple[str, object, float]]:
    words = {"on": True, "off": False}
    return [
        (x["name"], words[x["value"]] if x["value"] in words else json.loads(x["value"]), x["t"])
        for x in EVENT.finditer(cell)
    ]


@pytest.mark.parametrize("dof", [2, 3, 6, 7])
def test_csv_comes_back_in_pandas(
    table: Callable[..., Table], tmp_path: FilePath, dof: int
) -> None:
    given = table(dof)
    write_table(given, tmp_path / "a.csv", format="csv")
    found = pd.read_csv(tmp_path / "a.csv")
    assert len(found.columns) == 1 + 3 * dof + 1
    assert_columns(found, given, 0.5000001e-12)
    cells = found["events"].fillna("")
    expected = [(x.name, x.value, f"{x.t:.12f}") for x in given.events]
    assert [x for cell in cells for x in events_in(cell)] == expected
    assert [i for i, cell in enumerate(cells) for _ in events_in(cell)] == given.point_of_events


def test_csv_without_events_is_what_check_reads(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = table(6, events=())
    write_table(given, tmp_path / "a.csv", format="csv")
    found = read_trajectory(tmp_path / "a.csv", given.joint_names)
    for name in ("t", "q", "dq", "ddq"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(given, name), rtol=0, atol=0.5000001e-12
        )


def test_csv_of_names_that_are_numbers_and_words_stays_apart(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    import dataclasses

    given = dataclasses.replace(table(2), joint_names=("joint 1", "1"))
    write_table(given, tmp_path / "a.csv", format="csv")
    assert_columns(pd.read_csv(tmp_path / "a.csv"), given, 1e-11)


def test_parquet_comes_back_to_the_last_bit(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    given = table(6)
    write_table(given, tmp_path / "a.parquet", format="parquet")
    found = pd.read_parquet(tmp_path / "a.parquet")
    assert_columns(found, given, 0.0)
    assert sum(len(events_in(x)) for x in found["events"].dropna()) == len(given.events)
    about = json.loads(pq.read_schema(tmp_path / "a.parquet").metadata[b"armcontour"])
    assert about["events"] == [event_data(x) for x in given.events]
    assert tuple(about["joint_names"]) == given.joint_names
    assert (about["name"], about["period"], about["start_time"]) == ("part 7", given.period, 0.0)


def test_npz_comes_back_to_the_last_bit_and_without_pickles(
    table: Callable[..., Table], tmp_path: FilePath
) -> None:
    import dataclasses

    given = dataclasses.replace(table(6), tool=np.ones((9, 3)), ddq=None)
    write_table(given, tmp_path / "a.npz", format="npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        for name in ("t", "q", "dq", "tool"):
            np.testing.assert_array_equal(found[name], getattr(given, name))
        assert "ddq" not in found
        assert found["joint_names"].tolist() == list(given.joint_names)
        assert found["event_name"].tolist() == [x.name for x in given.events]
        assert found["event_t"].tolist() == [x.t for x in given.events]
        assert found["event_due"].tolist() == [x.due for x in given.events]
        values = [json.loads(x) for x in found["event_value"].tolist()]
        assert values == [x.value for x in given.events]
        assert [type(x) for x in values] == [type(x.value) for x in given.events]
        assert float(found["period"]) == given.period and str(found["name"]) == "part 7"
