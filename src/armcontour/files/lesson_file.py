"""Reader and writer for files with a learning result (lesson) and its runs."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.control.learning import LearningResult, LearningRun
from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import MAX_RECORDED, read_bytes
from armcontour.motion import Trajectory
from armcontour.robot.servo import ServoModel

# Version of lesson files; must increase if their content changes.
VERSION = 6
# Fields that are not stored as arrays or plain values: they are computed again from the job and the
# plan, or are stored separately.
NOT_STORED = ("trajectory", "runs", "lifted", "servo", "rule", "limit_cost")
# Names of a run's arrays: number of the run and name of the field.
RUN_ARRAY = "run {}: {}"
# Name of the JSON entry with all values that are not arrays.
JSON_ENTRY = "about.json"
# Name of the lesson file, next to the set-points of the next run.
LESSON = "lesson.npz"


def write_lesson(file: FilePath, lesson: LearningResult) -> None:
    """Write a lesson (result of learning) with all its runs, but without the plan, to a file."""
    arrays, plain = _split_fields(lesson, NOT_STORED)
    runs = []
    for number, run in enumerate(lesson.runs, start=1):
        run_arrays, plain_run = _split_fields(run)
        arrays |= {RUN_ARRAY.format(number, name): values for name, values in run_arrays.items()}
        runs.append(plain_run)
    about = {
        "version": VERSION,
        "armcontour": __version__,
        "lesson": plain,
        "servo": _plain_servo(lesson.servo),
        "runs": runs,
    }
    # Equal lessons give identical files, because neither NumPy nor ZipInfo writes the present time.
    with file.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with zipfile.ZipFile(file, "a") as target:
        target.writestr(
            zipfile.ZipInfo(JSON_ENTRY), json.dumps(about, indent=1), zipfile.ZIP_DEFLATED
        )


def _plain_servo(servo: ServoModel) -> dict[str, Any]:
    """Return the fields of a servo with lists instead of arrays."""
    plain = {}
    for field in dataclasses.fields(servo):
        value = getattr(servo, field.name)
        plain[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return plain


def read_lesson(file: FilePath, plan: Trajectory) -> LearningResult:
    """Read a lesson that `write_lesson` wrote; `plan` is the plan of its set-points."""
    content = read_bytes(file, "lesson file")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as source:
            if sum(x.file_size for x in source.zip.infolist()) > MAX_RECORDED:
                raise ValueError(f"the unpacked size must be at most {MAX_RECORDED} bytes")
            about = json.loads(source[JSON_ENTRY])
            if about["version"] != VERSION:
                raise InvalidInput(
                    f"the lesson file has version {about['version']}, written by armcontour "
                    f"{about['armcontour']}, but armcontour {__version__} requires version "
                    f"{VERSION}. Continue learning with that version, or start again with "
                    "the set-points of the job."
                )
            arrays: dict[str, Any] = {x: source[x] for x in source.files if x != JSON_ENTRY}
        runs = []
        for number, plain in enumerate(about["runs"], start=1):
            start = RUN_ARRAY.format(number, "")
            run_arrays = {
                x.removeprefix(start): y for x, y in arrays.items() if x.startswith(start)
            }
            runs.append(LearningRun(**plain, **run_arrays))
        return LearningResult(
            trajectory=plan,
            runs=tuple(runs),
            servo=ServoModel(**about["servo"]),
            **about["lesson"],
            **{x: y for x, y in arrays.items() if ": " not in x},
        )
    except InvalidInput as error:
        raise error.with_location(str(file)) from None
    except Exception as error:
        # Reading a damaged zip file can raise almost any exception.
        raise InvalidInput(
            f"{file} is not a lesson file, or is damaged ({type(error).__name__}). Start learning "
            "again with the set-points of the job."
        ) from None


def _split_fields(
    value: LearningResult | LearningRun, left_out: tuple[str, ...] = ()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of a dataclass by name: arrays, and other values; without the fields `left_out`."""
    named = {
        x.name: getattr(value, x.name) for x in dataclasses.fields(value) if x.name not in left_out
    }
    arrays = {name: x for name, x in named.items() if isinstance(x, np.ndarray)}
    return arrays, {name: x for name, x in named.items() if name not in arrays}
