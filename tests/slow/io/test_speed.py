"""Time of one processor for texts that the Studio and exports write."""

import time
import timeit

import numpy as np
from tests.io.test_job_edits import PAPER

from armcontour._yaml import load
from armcontour.io.exports import csv_text
from armcontour.io.job_edits import Change, change_data, change_text


def test_changes_of_the_papers_job_are_fast():
    data, change = load(PAPER, ""), [Change(("path", "points", 1, 0), 0.42)]

    def least(work, times):
        return min(timeit.repeat(work, number=1, repeat=times, timer=time.process_time))

    assert least(lambda: change_data(data, change), 50) < 100e-6
    assert least(lambda: change_text(PAPER, change), 7) < 0.1


def test_200_000_set_points_of_six_joints_are_text_in_a_fifth_of_a_second():
    rows = np.random.default_rng(0).normal(size=(200_000, 7))
    work = timeit.repeat(lambda: csv_text(["x"] * 7, [rows]), number=1, timer=time.process_time)
    assert min(work) < 0.2
