"""User files: the only room that knows units other than SI."""

from armcontour.io.job_file import json_schema, parse_job, read_job
from armcontour.io.results import ResultFolder
from armcontour.io.summary import summary, taught_csv

__all__ = ["ResultFolder", "json_schema", "parse_job", "read_job", "summary", "taught_csv"]
