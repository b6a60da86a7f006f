"""Certifying the paper's job against plain rounds of it: plan, compensate, execute, evaluate."""

from __future__ import annotations

from dataclasses import replace

import armcontour as ac
from armcontour.cli.running import built_in_job
from benchmarks.measured import Measured, paired

RUNS = 3


def measure() -> list[Measured]:
    """The job's run "optimal", compensated by the inverse every 4 ms."""
    whole = built_in_job()
    run = next(x for x in whole.runs if x.name == "optimal")
    this = replace(run, compensation="inverse", period=4e-3, experiment=None)
    job = replace(whole, runs=(this,), published=None)
    times = paired(lambda: ac.certify(job, servo=2e-6, rms=5e-7), lambda: ac.run(job), RUNS)
    return [Measured("certify, the paper's job", times[0], "one plain round", times[1], "< 30")]
