"""Certify the paper's job, compared with plain rounds of planning, execution and evaluation.

A round plans, compensates, executes and evaluates. It is not a peer: if rounds become faster,
certifying seems slower.
"""

from __future__ import annotations

from dataclasses import replace

import armcontour as ac
from armcontour.cli.run_command import built_in_job
from benchmarks import reference
from benchmarks.measured import Line, Pair, timed

MOST_ROUNDS = 30


def lines() -> list[Line]:
    """Return the line for the job's run "optimal", compensated by the inverse every 4 ms."""
    return [Line("certify", "certify, the paper's job", reference.NAME, _prepare)]


def _prepare() -> Pair:
    whole = built_in_job()
    run = next(x for x in whole.runs if x.name == "optimal")
    inverse_run = replace(run, compensation=ac.Inverse(), cycle=4e-3, experiment=None)
    job = replace(whole, runs=(inverse_run,))
    ours = timed(lambda: ac.certify(job, goal=ac.CertificateGoal(servo_error=2e-6, rms=5e-7)))
    plain = timed(lambda: ac.run(job))

    def notes() -> list[str]:
        many = ours(1)[0].processor / min(x.processor for x in plain(5))
        return [f"{many:.1f} plain rounds (bar: {MOST_ROUNDS})"]

    return Pair(ours, timed(reference.work), notes)
