"""Batches of many jobs: speed, engines, kills, poison and a million rows.

    python -m soak.batch speed [--jobs 10000]     one worker against one for each processor
    python -m soak.batch engines [--jobs 10000]   process, pool, LocalCluster, 8 shards: same rows
    python -m soak.batch kills [--times 20]       kill -9 of a worker and of the parent
    python -m soak.batch poison                   jobs that exit, eat memory, never end
    python -m soak.batch rows [--jobs 1000000]    memory of the parent

The jobs are the paper's, of corner tolerance by assigned velocity. Exit code 1 if something is not
as it must be. Speed needs a quiet machine: beside the clock it prints the processor's time, which
other work changes less.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

import armcontour as ac
from armcontour._process import processors
from armcontour.batches import read_plan
from armcontour.batches.conducting import conduct
from armcontour.batches.folder import look
from armcontour.batches.ledger import Ledger
from armcontour.batches.working import Outcome

# Bars: speed of two processors over one, the share of an engine, memory of the parent [bytes].
FASTER, SHARE, MEMORY = 1.8, 0.10, 500e6
# Longest work that a killed batch may lose [s].
LOST = 5.0


def plan_of(folder: FilePath, jobs: int) -> FilePath:
    """A plan of about so many jobs in a folder: the paper's job, tolerance by speed."""
    paper = resources.files("armcontour.jobs") / "library" / "paper.yaml"
    (folder / "paper.yaml").write_bytes(paper.read_bytes())
    side = math.isqrt(jobs)
    plan = {
        "job": "paper.yaml",
        "run": "optimal",
        "over": {
            "corners.tolerance": {"from": "0.1 mm", "to": "10 mm", "steps": side, "scale": "log"},
            "limits.speed": {"from": "0.05 m/s", "to": "0.25 m/s", "steps": side},
            "runs.optimal.command_interval": "4 ms",
            "experiment": None,
        },
    }
    (folder / "plan.yaml").write_text(json.dumps(plan))
    return folder / "plan.yaml"


def rows(found: ac.Batch) -> list[dict[str, Any]]:
    """The rows without what may differ from run to run."""
    return [
        {key: x for key, x in row.items() if "(not reproducible)" not in key}
        for row in found.rows()
    ]


def spent() -> tuple[float, float]:
    """Processor time of this process, and of its ended children [s]."""
    own, others = (
        resource.getrusage(resource.RUSAGE_SELF),
        resource.getrusage(resource.RUSAGE_CHILDREN),
    )
    return own.ru_utime + own.ru_stime, others.ru_utime + others.ru_stime


def say(text: str) -> None:
    """Print a line now."""
    print(text, flush=True)


def speed(folder: FilePath, options: argparse.Namespace) -> bool:
    """The clock of all processors over one, and what the engine adds to the time of the jobs."""
    plan = plan_of(folder, options.jobs)
    loop, together = _loops(plan, 1), _loops(plan, processors())
    say(
        f"without an engine, {processors()} loops at once do {loop / together * processors():.2f} "
        f"times the jobs of one: the most that this machine gives"
    )
    took, found_by = {}, {}
    for workers in (1, processors()):
        begin, (own, others) = time.perf_counter(), spent()
        found = ac.batch(plan, folder / f"speed-{workers}", workers=workers)
        took[workers] = time.perf_counter() - begin
        found_by[workers] = rows(found)
        own, others = (b - a for a, b in zip((own, others), spent(), strict=True))
        ideal = (loop if workers == 1 else together) * len(found.plan)
        say(
            f"{workers} workers: {len(found.plan)} jobs in {took[workers]:.1f} s by the clock; "
            f"processor: {own:.1f} s here, {others:.1f} s in workers; in a loop {ideal:.1f} s; the "
            f"engine adds {(own + others) / ideal - 1:.1%} (bar {SHARE:.0%})"
        )
    ratio = took[1] / took[processors()]
    same = found_by[1] == found_by[processors()]
    say(
        f"{processors()} workers are {ratio:.2f} times as fast as one (bar {FASTER} for two); "
        f"{'the same rows' if same else 'OTHER ROWS'}"
    )
    return same and ratio >= FASTER and (own + others) / ideal - 1 <= SHARE


def _loops(plan: FilePath, count: int) -> float:
    """Processor time of a job with nothing but `run`, while so many processes work on jobs [s]."""
    call = [sys.executable, "-m", "soak.batch", LOOP, "--plan", str(plan)]
    children = [subprocess.Popen(call, stdout=subprocess.PIPE, text=True) for _ in range(count)]
    return max(float(x.communicate()[0]) for x in children)


def work_alone(plan: FilePath, seed: int) -> None:
    """Print the processor time of a job with nothing but `run` [s]: some jobs of a plan."""
    found = read_plan(plan)
    base = found.bases[0]
    chosen = [
        base.job(base.at(found.keys, found.values(k)))
        for k in random.Random(seed).sample(range(len(found)), min(400, len(found)))
    ]
    ac.run(chosen[0])
    begin = time.process_time()
    for job in chosen:
        ac.run(job)
    say(f"{(time.process_time() - begin) / len(chosen)}")


def engines(folder: FilePath, options: argparse.Namespace) -> bool:
    """The same rows in this process, in a pool, on a LocalCluster and in 8 shards."""
    import distributed

    plan = plan_of(folder, options.jobs)
    want = rows(ac.batch(plan, folder / "pool"))
    good = True

    def compare(name: str, found: ac.Batch) -> None:
        nonlocal good
        same = rows(found) == want
        good &= same
        say(f"{name}: {len(want)} rows, {'the same' if same else 'OTHERS'}")

    compare("this process", ac.batch(plan, folder / "here", workers=0))
    for k in range(1, 9):
        found = ac.batch(plan, folder / "shards", workers=1, shard=(k, 8))
    compare("8 shards", found)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:
        compare("LocalCluster", ac.batch(plan, folder / "dask", cluster=cluster.scheduler_address))
    return good


def kills(folder: FilePath, options: argparse.Namespace) -> bool:
    """Resumed results after kills of a worker and of the parent, at random moments."""
    plan = plan_of(folder, options.jobs)
    draw = random.Random(options.seed)
    begin = time.perf_counter()
    want = rows(ac.batch(plan, folder / "whole"))
    whole = time.perf_counter() - begin
    good = True
    for name in [options.only] if options.only else ["worker", "parent"]:
        out = folder / name
        done, lost = 0, []
        while done < options.times:
            with _started(plan, out) as process:
                told = Told(process)
                _wait_for_work(process, out)
                if name == "worker":
                    done += _kill_workers(process, draw, options.times - done, whole)
                else:
                    try:
                        process.wait(draw.uniform(0.0, whole))
                    except subprocess.TimeoutExpired:
                        process.kill()
                        done += 1
                        lost.append(told.lost(_kept(plan, out)))
                        continue
            good &= _same(rows(ac.batch(plan, out, workers=0)), want)
            say(f"{name}: complete after {done} kills")
            shutil.rmtree(out)
        if out.exists():
            good &= _same(rows(ac.batch(plan, out, workers=0)), want)
        say(f"{name}: killed {done} times, {'the same rows' if good else 'OTHER ROWS'}")
        if lost:
            say(f"parent: lost at most {max(lost):.1f} s of work (bar {LOST:.0f})")
            good &= max(lost) <= LOST
    return good


def _started(plan: FilePath, out: FilePath) -> subprocess.Popen[str]:
    """A batch of its own, which tells how far it is as lines of JSON."""
    call = [sys.executable, "-m", "armcontour", "batch", str(plan), "--out", str(out), "--json"]
    return subprocess.Popen(
        call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, bufsize=1
    )


class Told:
    """What a batch tells of itself, and when.

    Args:
        process: The batch.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        # Times, and how many jobs had a result by then.
        self.done: list[tuple[float, int]] = []
        self._reader = threading.Thread(target=self._read, args=(process,), daemon=True)
        self._reader.start()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            told = json.loads(line).get("progress")
            if told:
                self.done.append((time.monotonic(), told["done"]))

    def lost(self, kept: int) -> float:
        """For how long at most the batch had worked in vain when it was killed, now [s].

        Args:
            kept: How many results its parts have.
        """
        now = time.monotonic()
        self._reader.join()
        in_vain = [t for t, done in self.done if done > kept]
        if not in_vain:
            return 0.0
        before = [t for t, done in self.done if done <= kept]
        return now - (before[-1] if before else in_vain[0])


def _kept(plan: FilePath, out: FilePath) -> int:
    """How many jobs of a plan have a result in a folder."""
    ledger = Ledger(read_plan(plan))
    look(out, ledger)
    return ledger.done


def _wait_for_work(process: subprocess.Popen[str], out: FilePath) -> None:
    """Wait until a batch has begun, which it says by writing its plan again."""
    begin = time.time()
    plan = out / "plan.json"
    while process.poll() is None and not (plan.exists() and plan.stat().st_mtime >= begin):
        time.sleep(0.02)


def _kill_workers(
    process: subprocess.Popen[str], draw: random.Random, most: int, whole: float
) -> int:
    """Kill workers of a batch at random moments, until it ends; returns how many.

    Kills come about twice in the time of a whole batch: a job in work in three workers that are
    killed would be given up, as it should.
    """
    done = 0
    while done < most:
        try:
            process.wait(draw.uniform(0.0, whole))
            break
        except subprocess.TimeoutExpired:
            children = _children(process.pid)
            if children:
                os.kill(draw.choice(children), signal.SIGKILL)
                done += 1
    return done


def _children(pid: int) -> list[int]:
    """Processes that a process has started."""
    found = []
    for x in FilePath(f"/proc/{pid}/task").iterdir():
        found += [int(y) for y in (x / "children").read_text().split()]
    return found


def _same(found: Sequence[Any], want: Sequence[Any]) -> bool:
    """Whether rows are the same; says which is not."""
    for a, b in zip(found, want, strict=False):
        if a != b:
            say(f"row {b['number']}: {a} instead of {b}")
            return False
    return len(found) == len(want)


class Poisoned:
    """Work on numbers, of which some ruin their process.

    Args:
        work: What is done with the items of a plan.
        poison: What some numbers do.
    """

    def __init__(self, work: Any, poison: dict[int, str]) -> None:
        self.work, self.poison = work, poison

    def __call__(self, items: Sequence[Any]) -> list[Outcome]:
        """Work on some items; the poison is where the job would be."""
        from armcontour.batches import working

        usual = working._figures
        working._figures = self._figures(usual)  # type: ignore[assignment]
        try:
            return list(self.work(items))
        finally:
            working._figures = usual

    def _figures(self, usual: Callable[..., Any]) -> Callable[..., Any]:
        def figures(plan: Any, item: Any) -> Any:
            kind = self.poison.get(round(item[1][1] * 1e6))
            if kind == "exits":
                os._exit(3)
            if kind == "crashes":
                os.kill(os.getpid(), signal.SIGSEGV)
            if kind == "leaves":
                sys.exit(1)
            if kind == "eats":
                eaten = []
                while True:
                    eaten.append(bytearray(10_000_000))
            if kind == "never ends":
                while True:
                    pass
            if kind == "never ends, deaf":
                signal.signal(signal.SIGALRM, signal.SIG_IGN)
                while True:
                    time.sleep(1.0)
            return usual(plan, item)

        return figures


POISON = {
    "exits": "killed",
    "crashes": "killed",
    "leaves": "killed",
    "eats": "out of memory",
    "never ends": "timed out",
    "never ends, deaf": "timed out",
}


def poison(folder: FilePath, options: argparse.Namespace) -> bool:
    """A job that exits, eats memory or never ends costs itself only."""
    from armcontour._executors import open_engine
    from armcontour.batches.working import work_on

    path = plan_of(folder, 225)
    data = json.loads(path.read_text())
    data["limits"] = {"time": "8 s", "memory": "0.3 GB"}
    path.write_text(json.dumps(data))
    plan = read_plan(path)
    speeds = [x.values for x in plan.parameters if x.key == "limits.speed"][0]
    kinds = dict(zip([1, 4, 6, 8, 10, 13], POISON, strict=True))
    ruined = {round(speeds[k] * 1e6): kind for k, kind in kinds.items()}
    # One job of each of these speeds only.
    jobs = [
        (k, (plan.base(k), plan.values(k)))
        for k in range(len(plan))
        if k % 15 not in kinds or k // 15 == 7
    ]
    found: dict[int, Outcome] = {}
    with open_engine(workers=2) as engine:
        work = Poisoned(work_on(plan, engine, []), ruined)
        conduct(
            engine.executor,
            work,
            jobs,
            workers=2,
            take=lambda k, x: found.__setitem__(k, x),
            time=plan.time,
        )
    good = len(found) == len(jobs)
    for k, x in sorted(found.items()):
        kind = kinds.get(k % 15)
        want = "done" if kind is None else POISON[kind]
        if kind is not None:
            say(f"a job that {kind}: {x.status} after {x.tries} tries; {x.sentence}")
        good &= x.status == want
    done = sum(x.status == "done" for x in found.values())
    say(f"{done} of {len(jobs) - len(kinds)} others are done")
    return good


class Quick:
    """Work that takes no time: numbers in the place of figures."""

    def __call__(self, items: Sequence[Any]) -> list[Outcome]:
        """Numbers for some items."""
        return [
            Outcome("done", figures=(x[1][0], x[1][1], 0.0, 1.0, 2.0), seconds=1e-3, worker="one")
            for x in items
        ]


def million(folder: FilePath, options: argparse.Namespace) -> bool:
    """Memory of the parent with many rows, which take no time to compute."""
    from armcontour.batches import batching

    batching.work_on = lambda *_: Quick()  # type: ignore[assignment]
    begin, (own, _) = time.perf_counter(), spent()
    found = ac.batch(plan_of(folder, options.jobs), folder / "rows", workers=1)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    size = (folder / "rows" / "results.parquet").stat().st_size
    say(
        f"{len(found.plan)} rows: the parent took {most / 1e6:.0f} MB (bar {MEMORY / 1e6:.0f}), "
        f"and {(spent()[0] - own) / len(found.plan) * 1e3:.3f} ms of processor a row; "
        f"{time.perf_counter() - begin:.0f} s by the clock; results.parquet has {size / 1e6:.0f} MB"
    )
    return most < MEMORY and found.complete


KINDS = {"speed": speed, "engines": engines, "kills": kills, "poison": poison, "rows": million}
LOOP = "loop"
JOBS = {"kills": 1500, "rows": 1_000_000}


def main() -> None:
    """Do one kind of soak, or all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("kind", nargs="?", choices=(*KINDS, LOOP))
    parser.add_argument("--plan", type=FilePath, help=argparse.SUPPRESS)
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--only", choices=("worker", "parent"), help="whom kills are for")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.kind == LOOP:
        work_alone(options.plan, options.seed)
        return
    jobs = options.jobs
    good = True
    for kind in [options.kind] if options.kind else KINDS:
        options.jobs = jobs or JOBS.get(kind, 10_000)
        with tempfile.TemporaryDirectory(prefix="batch-") as name:
            good &= KINDS[kind](FilePath(name), options)
    sys.exit(not good)


if __name__ == "__main__":
    # Other processes know what is sent to them by the name of this module.
    from soak import batch

    batch.main()
