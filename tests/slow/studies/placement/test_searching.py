"""Threads and processes find the same places as one process."""

from concurrent.futures import ThreadPoolExecutor

from tests.studies.placement.conftest import PLANE

import armcontour as ac
from armcontour.files import parse_job, placement_csv


def test_threads_and_processes_find_the_same():
    job, progress_log = parse_job(PLANE), []
    over = {"x": (-0.04, 0.04, 5), "yaw": (-0.5, 0.5, 3)}
    alone = ac.place(job, ac.PlaceSearch(over=over), processes=1)
    with ThreadPoolExecutor(3) as threads:
        placement = ac.place(job, ac.PlaceSearch(over=over), executor=threads)
    tell = lambda x: progress_log.append(x.done or 0.0)  # noqa: E731
    pool = ac.place(job, ac.PlaceSearch(over=over), processes=2, progress=tell)
    assert placement_csv(placement) == placement_csv(pool) == placement_csv(alone)
    assert placement.refined.values == pool.refined.values == alone.refined.values
    assert max(progress_log) == 1.0
