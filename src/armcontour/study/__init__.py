"""Jobs and studies: all arrows at once."""

from armcontour.study.job import Job, Published, Rounding, Run
from armcontour.study.study import STEPS, RunResult, Study, path_of, run

__all__ = ["STEPS", "Job", "Published", "Rounding", "Run", "RunResult", "Study", "path_of", "run"]
