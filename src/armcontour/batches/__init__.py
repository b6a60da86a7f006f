"""Many jobs: plans over keys of job files, executors that work on them, results that grow."""

from armcontour.batches.batching import Batch, Tally, batch
from armcontour.batches.plan import Plan, read_plan

__all__ = ["Batch", "Plan", "Tally", "batch", "read_plan"]
