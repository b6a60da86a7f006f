"""Many jobs: plans over keys of job files, executors that work on them, results that grow."""

from armcontour.batches.batching import Batch, BatchProgress, batch
from armcontour.batches.plan import Plan, read_plan

__all__ = ["Batch", "Plan", "BatchProgress", "batch", "read_plan"]
