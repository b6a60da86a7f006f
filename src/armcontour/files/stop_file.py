"""Reader of a stopped motion: the result folder of `play`, with the place of the stop."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.files.log_file import read_log
from armcontour.files.result_folder import SUMMARY, verify_file
from armcontour.jobs.stopped_place import StoppedPlace

# Record of the joints in a result folder of `play`.
LOG = "log.csv"


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
