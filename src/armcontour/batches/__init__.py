"""Batches of jobs: plans over keys of job files, execution by workers, and stored results."""

from armcontour.batches.plan import Plan, read_plan
from armcontour.batches.runner import Batch, BatchProgress, batch

__all__ = ["Batch", "Plan", "BatchProgress", "batch", "read_plan"]
