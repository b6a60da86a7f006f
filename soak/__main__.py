"""`python -m soak`: plan and judge many random problems; exit code 1 if one goes wrong."""

from __future__ import annotations

import argparse
import heapq
import os
import sys
from collections import Counter
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from itertools import islice

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from soak.judge import Outcome, run

CHUNK = 100
SLOWEST = 3


def _run_all(seeds: range) -> list[Outcome]:
    return [run(seed) for seed in seeds]


def main() -> int:
    """Run the soak; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m soak", description=__doc__)
    parser.add_argument("--count", type=int, default=100_000, help="how many problems")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first one")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    given = parser.parse_args()
    last = given.first_seed + given.count
    chunks = (range(a, min(a + CHUNK, last)) for a in range(given.first_seed, last, CHUNK))
    counts: Counter[str] = Counter()
    slowest: list[tuple[float, int, str]] = []
    worst = 0.0
    console = Console()
    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]:.0f}/s"),
        TimeRemainingColumn(),
    )
    with (
        Progress(*columns, console=console) as progress,
        ProcessPoolExecutor(given.jobs) as pool,
    ):
        task = progress.add_task("soak", total=given.count, rate=0.0)
        waiting: dict[Future[list[Outcome]], range] = {}
        while True:
            for chunk in islice(chunks, 2 * given.jobs - len(waiting)):
                waiting[pool.submit(_run_all, chunk)] = chunk
            if not waiting:
                break
            for done in wait(waiting, return_when=FIRST_COMPLETED).done:
                seeds = waiting.pop(done)
                try:
                    outcomes = done.result()
                except Exception as error:
                    console.print(f"A process died in seeds {seeds[0]} to {seeds[-1]}: {error}")
                    return 1
                for outcome in outcomes:
                    counts[outcome.result] += 1
                    worst = max(worst, outcome.worst)
                    heapq.heappush(slowest, (outcome.seconds, outcome.seed, outcome.kind))
                    if len(slowest) > SLOWEST:
                        heapq.heappop(slowest)
                    if outcome.failed:
                        console.print(
                            f"seed {outcome.seed} ({outcome.kind}) {outcome.result}: "
                            f"{outcome.note}",
                            markup=False,
                            highlight=False,
                            soft_wrap=True,
                        )
                progress.advance(task, len(outcomes))
                progress.update(task, rate=progress.tasks[0].speed or 0.0)
    for seconds, seed, kind in sorted(slowest, reverse=True):
        console.print(f"slowest: seed {seed} ({kind}) {seconds:.2f} s", highlight=False)
    console.print(
        f"seeds {given.first_seed} to {last - 1}: {counts['planned']} planned, "
        f"{counts['refused']} refused, {counts['violation']} violations above 1 + 1e-9, "
        f"{counts['dishonest']} dishonest refusals, {counts['crash']} crashes; "
        f"largest ratio 1 {worst - 1:+.2e}",
        highlight=False,
        soft_wrap=True,
    )
    return int(counts["violation"] + counts["dishonest"] + counts["crash"] > 0)


if __name__ == "__main__":
    sys.exit(main())
