"""Certifying the paper's job against plain rounds of it: plan, compensate, execute, evaluate."""

from __future__ import annotations

from dataclasses import replace

import armcontour as ac
from armcontour.cli.running import built_in_job
from benchmarks.measured import Bar, Line, Pair, timed


def lines() -> list[Line]:
    """The job's run "optimal", compensated by the inverse every 4 ms."""
    return [Line("certify", "certify, the paper's job", "one plain round", _prepare, Bar(ratio=30))]


def _prepare() -> Pair:
    whole = built_in_job()
    run = next(x for x in whole.runs if x.name == "optimal")
    this = replace(run, compensation="inverse", period=4e-3, experiment=None)
    job = replace(whole, runs=(this,), published=None)
    return Pair(
        timed(lambda: ac.certify(job, servo=2e-6, rms=5e-7)),
        timed(lambda: ac.run(job)),
    )
