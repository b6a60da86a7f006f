"""Files of lessons: what learning keeps from run to run, exact to the last bit."""

from __future__ import annotations

import dataclasses
import io
import json
import zipfile
from math import isfinite
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._files import LARGE, read_bytes
from armcontour._version import __version__
from armcontour.errors import InvalidInput
from armcontour.learning import LearnedRun, Lesson
from armcontour.motion import Trajectory
from armcontour.servo import ServoModel

# Changes with the content of these files.
VERSION = 3
# Plan and command limits are made again from the job, and the model of the response from the plan.
LEFT_OUT = ("trajectory", "runs", "lifted", "servo", "misfits", "command_limits", "limit_cost")
RUN = "run {}: {}"
# Types of values that are no arrays, by the annotations of their fields.
KINDS: dict[Any, tuple[type, ...]] = {
    "Time": (float, int),
    "float": (float, int),
    "float | None": (float, int, type(None)),
    "FloatArray | None": (type(None),),
    "int": (int,),
    "bool": (bool,),
    "str": (str,),
}
# The first moment that a zip file can name, so that equal lessons are equal files.
MOMENT = (1980, 1, 1, 0, 0, 0)


def write_lesson(file: FilePath, lesson: Lesson) -> None:
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
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr(_entry("about.json"), json.dumps(about, indent=1))
        for name, values in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(values), allow_pickle=False)
            target.writestr(_entry(f"{name}.npy"), content.getvalue())


def read_lesson(file: FilePath, plan: Trajectory) -> Lesson:
    """Read a lesson that `write_lesson` wrote.

    Args:
        file: The file.
        plan: The plan that the lesson is about.

    Raises:
        InvalidInput: The file is none of these, of another version, or damaged.
    """
    content = read_bytes(file, "file of learning")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as source:
            if sum(x.file_size for x in source.infolist()) > LARGE:
                raise ValueError("its content is too large")
            about = json.loads(source.read("about.json"))
            if about["version"] != VERSION:
                raise InvalidInput(
                    f"it is of version {about['version']} of such files, by armcontour "
                    f"{about['armcontour']}, and armcontour {__version__} reads version {VERSION}: "
                    "learn with that one, or begin again with the taught data of the job."
                )
            arrays = {
                x.filename.removesuffix(".npy"): _read_array(source.read(x))
                for x in source.infolist()
                if x.filename.endswith(".npy")
            }
        runs = tuple(
            LearnedRun(**_checked(LearnedRun, plain), **_arrays_of(number, arrays))
            for number, plain in enumerate(about["runs"], start=1)
        )
        own: dict[str, Any] = {name: values for name, values in arrays.items() if ": " not in name}
        before, after = (float(x) for x in about["misfits"])
        return Lesson(
            trajectory=plan,
            runs=runs,
            servo=ServoModel(**about["servo"]),
            misfits=(before, after),
            **_checked(Lesson, about["lesson"]),
            **own,
        )
    except InvalidInput as error:
        raise error.at(str(file)) from None
    except Exception as error:
        # A damaged zip file can raise almost anything.
        raise InvalidInput(
            f"{file} is no file of learning, or is damaged ({type(error).__name__}): begin again "
            "with the taught data of the job."
        ) from None


def _split(
    value: Lesson | LearnedRun, left_out: tuple[str, ...] = ()
) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """The fields of a dataclass that are arrays, and those that are numbers or text."""
    named = {
        x.name: getattr(value, x.name) for x in dataclasses.fields(value) if x.name not in left_out
    }
    arrays = {name: x for name, x in named.items() if isinstance(x, np.ndarray)}
    return arrays, {name: x for name, x in named.items() if name not in arrays}


def _checked(of: type, values: dict[str, Any]) -> dict[str, Any]:
    """Values of fields, which must be of the types of the fields."""
    known = {x.name: KINDS[x.type] for x in dataclasses.fields(of) if x.type in KINDS}
    for name, value in values.items():
        if not isinstance(value, known[name]) or (isinstance(value, float) and not isfinite(value)):
            raise ValueError(f"{name} is {value!r}")
    return values


def _entry(name: str) -> zipfile.ZipInfo:
    """A compressed entry of a zip file."""
    entry = zipfile.ZipInfo(name, MOMENT)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _read_array(content: bytes) -> FloatArray:
    """A finite array of doubles."""
    found = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    if found.dtype != np.float64 or not np.isfinite(found).all():
        raise ValueError("an array is not of finite doubles")
    return np.asarray(found)


def _arrays_of(number: int, arrays: dict[str, FloatArray]) -> dict[str, Any]:
    """The arrays of one run by their names."""
    start = RUN.format(number, "")
    return {x.removeprefix(start): y for x, y in arrays.items() if x.startswith(start)}
