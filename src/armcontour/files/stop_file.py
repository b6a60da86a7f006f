"""Reader of a stopped motion: the result folder of `play`, with the place of the stop.

A command that did not end leaves only the record of its feeder. A comment names what was played.
"""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import numpy as np

from armcontour.controllers import UnfinishedMotion
from armcontour.controllers.controller import UNFINISHED
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.files.log_file import read_log
from armcontour.files.result_folder import SUMMARY, verify_file
from armcontour.jobs.job import Job
from armcontour.jobs.stopped_place import StoppedPlace

# Record of the joints in a result folder of `play`.
LOG = "log.csv"
# Beginning of the comment that says what was played.
PLAYED = "# played: "


@checked
def read_stopped_place(folder: str | FilePath) -> StoppedPlace:
    """Read where a motion was stopped, from the result folder of `armcontour play`.

    Args:
        folder: The folder of `--out`.

    Raises:
        InvalidInput: The motion was played to its end, or the folder has another result.
        FileError: The folder has no result, or a file has changed.
    """
    location = FilePath(folder)
    file = verify_file(location, SUMMARY)
    try:
        data = json.loads(read_text(file, "summary"))
        was_completed = data["completed"]
        stop = data.get("resume")
        if stop is not None:
            place = (stop["at"], stop["place"], stop["job"], stop["run"])
            only = tuple(map(str, stop["only"]))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InvalidInput(
            f"{file} is not the summary of a motion that armcontour play has recorded "
            f"({type(error).__name__})."
        ) from None
    if stop is None:
        what = "was not stopped"
        if was_completed:
            what = "was played to its end, so nothing is left"
        raise InvalidInput(f"The motion in {location} {what}. Specify the folder of a stopped one.")
    resume_at, words, job, run = place
    log = read_log(verify_file(location, LOG))
    return StoppedPlace(
        resume_at=resume_at,
        words=words,
        job=job,
        run=run,
        only=only,
        measured=log.measured[-1],
    )


def unfinished_comment(job: Job, run: str) -> str:
    """Return the comment of a record that says what is played, without #.

    Args:
        job: The job.
        run: Name of the run.
    """
    process = job.process
    played = {
        "job": job.name,
        "run": run,
        "only": process.only,
        "resume_at": process.resume_at,
        "rejoin": process.rejoin,
    }
    return f"{PLAYED.removeprefix('# ')}{json.dumps(played)}"


@checked
def read_unfinished(folder: str | FilePath) -> UnfinishedMotion | None:
    """Read the record of a motion whose command did not end; None if the folder has none.

    The command was killed, or its terminal was closed.

    Args:
        folder: The folder of `--out`.

    Raises:
        InvalidInput: The record has another form.
        FileError: It cannot be read.
    """
    file = FilePath(folder) / UNFINISHED
    if not file.exists():
        return None
    lines = read_text(file, "record").splitlines()
    try:
        played = next(x for x in lines if x.startswith(PLAYED))
        settings = json.loads(played.removeprefix(PLAYED))
        rows = [x.split(",") for x in lines if not x.startswith("#")]
        # The last line may be incomplete.
        values = np.array([x for x in rows[1:] if len(x) == len(rows[0])], dtype=float)
        joints = (values.shape[1] - 2) // 2
        return UnfinishedMotion(
            job=settings["job"],
            run=settings["run"],
            only=tuple(settings["only"]),
            resume_at=settings["resume_at"],
            rejoin=settings["rejoin"],
            t=values[:, 0],
            measured=values[:, 1 + joints : 1 + 2 * joints],
            cycle=values[:, -1],
        )
    except (StopIteration, KeyError, TypeError, ValueError, IndexError) as error:
        raise InvalidInput(
            f"{file} is not the record of a motion that armcontour play has begun "
            f"({type(error).__name__})."
        ) from None
