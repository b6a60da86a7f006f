"""Time of one processor for changes of texts in the Studio."""

import time
import timeit
from importlib import resources

from armcontour.core.yaml_loader import load
from armcontour.files.job_text_edits import Change, change_data, change_text

PAPER = (resources.files("armcontour.jobs") / "library" / "paper.yaml").read_text("utf-8")


def test_changes_of_the_papers_job_are_fast():
    data, change = load(PAPER, ""), [Change(("path", "points", 1, 0), 0.42)]

    def shortest_time(work, times):
        return min(timeit.repeat(work, number=1, repeat=times, timer=time.process_time))

    assert shortest_time(lambda: change_data(data, change), 50) < 100e-6
    assert shortest_time(lambda: change_text(PAPER, change), 7) < 0.1
