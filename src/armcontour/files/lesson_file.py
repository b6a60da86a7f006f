"""Files of lessons: what learning keeps from run to run, exact to the last bit."""

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
from armcontour.core.file_access import LARGE, read_bytes
from armcontour.motion import Trajectory
from armcontour.robot.servo import ServoModel

# Changes with the content of these files.
VERSION = 3
# Plan and command limits are made again from the job, and the model of the response from the plan.
LEFT_OUT = ("trajectory", "runs", "lifted", "servo", "misfits", "command_limits", "limit_cost")
RUN = "run {}: {}"
# Entry with everything that is no array.
ABOUT = "about.json"


def write_lesson(file: FilePath, lesson: LearningResult) -> None:
    """Write a lesson with all its runs to a file, without the plan.

    Args:
        file: The file.
        lesson: The lesson.
    """
    arrays, plain = _split(lesson, LEFT_OUT)
    runs = []
    for number, run in enumerate(lesson.runs, start=1):
        of_run, own = _split(run)
        arrays |= {RUN.format(number, name): values for name, values in of_run.items()}
        runs.append(own)
    about = {
        "version": VERSION,
        "armcontour": __version__,
        "lesson": plain,
        "servo": {
            x.name: value.tolist() if isinstance(value, np.ndarray) else value
            for x in dataclasses.fields(lesson.servo)
            for value in [getattr(lesson.servo, x.name)]
        },
        "misfits": lesson.misfits,
        "runs": runs,
    }
    # Equal lessons are equal files: neither numpy nor ZipInfo writes the present time.
    with file.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with zipfile.ZipFile(file, "a") as target:
        target.writestr(zipfile.ZipInfo(ABOUT), json.dumps(about, indent=1), zipfile.ZIP_DEFLATED)


def read_lesson(file: FilePath, plan: Trajectory) -> LearningResult:
    """Read a lesson that `write_lesson` wrote.

    Args:
        file: The file.
        plan: The plan that the lesson is about.

    Raises:
        InvalidInput: The file is none of these, of another version, or damaged.
    """
    content = read_bytes(file, "file of learning")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as source:
            if sum(x.file_size for x in source.zip.infolist()) > LARGE:
                raise ValueError("its content is too large")
            about = json.loads(source[ABOUT])
            if about["version"] != VERSION:
                raise InvalidInput(
                    f"it is of version {about['version']} of such files, by armcontour "
                    f"{about['armcontour']}, and armcontour {__version__} reads version {VERSION}: "
                    "learn with that one, or begin again with the set-points of the job."
                )
            arrays: dict[str, Any] = {x: source[x] for x in source.files if x != ABOUT}
        runs = []
        for number, plain in enumerate(about["runs"], start=1):
            start = RUN.format(number, "")
            own = {x.removeprefix(start): y for x, y in arrays.items() if x.startswith(start)}
            runs.append(LearningRun(**plain, **own))
        before, after = about["misfits"]
        return LearningResult(
            trajectory=plan,
            runs=tuple(runs),
            servo=ServoModel(**about["servo"]),
            misfits=(before, after),
            **about["lesson"],
            **{x: y for x, y in arrays.items() if ": " not in x},
        )
    except InvalidInput as error:
        raise error.with_location(str(file)) from None
    except Exception as error:
        # A damaged zip file can raise almost anything.
        raise InvalidInput(
            f"{file} is no file of learning, or is damaged ({type(error).__name__}): begin again "
            "with the set-points of the job."
        ) from None


def _split(
    value: LearningResult | LearningRun, left_out: tuple[str, ...] = ()
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The fields of a dataclass that are arrays, and those that are numbers or text."""
    named = {
        x.name: getattr(value, x.name) for x in dataclasses.fields(value) if x.name not in left_out
    }
    arrays = {name: x for name, x in named.items() if isinstance(x, np.ndarray)}
    return arrays, {name: x for name, x in named.items() if name not in arrays}
