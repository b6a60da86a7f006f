"""Many jobs: plans over keys of job files, executors that work on them, results that grow."""

from armcontour.batches.plan import Plan, read_plan
from armcontour.batches.runner import Batch, BatchProgress, batch

__all__ = ["Batch", "Plan", "BatchProgress", "batch", "read_plan"]
