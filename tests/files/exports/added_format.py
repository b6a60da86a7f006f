"""Program that adds an export format with one function and one class, and prints what follows.

The format has the joint positions of each point, in degrees, on one line. It needs a process of its
own, because the module of the formats is changed before it is imported.
"""

from __future__ import annotations

import json
import sys
import tempfile
import types
from pathlib import Path

import numpy as np
from tests.jobs.added_limit import import_changed

LAST_CLASS = "\n# Formats by name."
LAST_KIND = ")\n}\n# Extensions of files"
CLASS = '''
@declared()
class DegreesFormat(ExportFormat):
    """Joint positions in degrees (.deg).

    Args:
        derivatives: Highest derivative; the format has none.
    """

    keeps_times: ClassVar[bool] = True
    kind: ClassVar[str] = "degrees"
    ending: ClassVar[str] = ".deg"
    derivatives: Derivatives | None = None

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        from armcontour.files.exports.degrees import write_degrees

        write_degrees(table, file)

'''
JOB = """
name: x
arm: pmk3s
path: {points: [[0.350, 0.100], [0.380, 0.125]]}
limits: {speed: 0.15 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 20 ms
runs: {only: {}}
export: {formats: [FORMATS]}
"""


def write_degrees(table, file):
    """Write the joint positions of each point, in degrees, on one line."""
    np.savetxt(file, np.degrees(table.q), fmt="%.9f")


def add_format():
    """Add the function, the class, and its name in the formats."""
    module = types.ModuleType("armcontour.files.exports.degrees")
    module.write_degrees = write_degrees
    sys.modules[module.__name__] = module
    added = {LAST_CLASS: CLASS, LAST_KIND: ", DegreesFormat"}
    import_changed("armcontour.files.exports.formats", added)


def rows_of(file):
    """Size of a written table."""
    return list(np.loadtxt(file).shape)


def command(*arguments):
    """Run a command of the command line, which has to succeed."""
    from armcontour.cli.commands import program_for

    sys.argv = ["armcontour", *map(str, arguments)]
    try:
        program_for(sys.argv[1:])()
    except SystemExit as end:
        assert not end.code


def facts(folder):
    """What each consumer makes of the new format."""
    from tools.job_form import form_text

    import armcontour as ac

    job_file = folder / "job.yaml"
    job_file.write_text(JOB.replace("FORMATS", "degrees"), encoding="utf-8")
    job = ac.read_job(job_file)
    plan = ac.plan(job.path, job.arm, job.runs[0].limits)
    set_points = ac.compensate(plan, job.servo, cycle=0.02)
    yield "set-points", list(set_points.q.shape)
    ac.export(set_points, folder / "a.deg")
    yield "by extension", rows_of(folder / "a.deg")
    ac.export(set_points, folder / "b.txt", "degrees")
    yield "by name", rows_of(folder / "b.txt")
    yield "same", np.allclose(np.radians(np.loadtxt(folder / "a.deg")), set_points.q, atol=1e-9)
    try:
        ac.files.parse_job(JOB.replace("FORMATS", "degree"))
    except ac.InvalidInput as error:
        yield "listed", "degrees" in str(error)
    for name, more in (("from job", ()), ("from option", ("--export", "degrees"))):
        out = folder / name.replace(" ", "_")
        command("run", job_file, "--out", out, *more)
        yield name, sorted(x.name for x in out.rglob("*.deg"))
    command("export", out, folder / "c.deg")
    yield "from result", rows_of(folder / "c.deg")
    yield "form", json.loads(form_text())["formats"]


if __name__ == "__main__":
    add_format()
    with tempfile.TemporaryDirectory() as temporary:
        found = dict(facts(Path(temporary)))
    print(json.dumps(found))
