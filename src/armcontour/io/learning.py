"""The summary of learning, as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from armcontour.core.render import plain
from armcontour.evaluation import ErrorProfile
from armcontour.io.json_text import to_json
from armcontour.jobs import Study
from armcontour.jobs.learning import JudgedStudy, LearningStudy
from armcontour.learning import LearnedRun

LEARNING_UNITS = {
    "tool_rms": "m",
    "tool_max": "m",
    "contour_rms": "m",
    "contour_max": "m",
    "joint_rms": "rad",
    "joint_max": "rad",
    "loop_noise": "rad",
    "predicted": "m",
    "set_points_off": "rad",
    "encoder_shift": "rad",
    "offset": "s",
    "delay": "s",
    "repeats": "m",
    "does_not_repeat": "m",
    "remaining": "m",
}
# What a lesson says beside its set-points and runs.
OF_LESSON = "delay predicted setbacks finished reason remaining noise_share".split()
# Arrays over time are in the file of the lesson.
LEFT_OUT = ("q", "error")


def learning_json(study: LearningStudy, files: Sequence[str] = ()) -> str:
    """Errors of all runs of learning as JSON, in SI units; in the form of a summary.

    Args:
        study: The runs, and what was learned from them.
        files: The files of the result, relative to its folder.
    """
    lesson, run = study.lesson, study.plan.run
    learned = {
        "run": run.name,
        **{name: getattr(lesson, name) for name in OF_LESSON},
        "repeats": lesson.repeats,
        "does_not_repeat": lesson.noise,
        "best": lesson.best + 1,
        "runs": [_fields(x) for x in lesson.runs],
        "notes": study.notes,
    }
    data = {**_summary(study, files), "learning": learned}
    return to_json(data)


def judged_json(study: JudgedStudy, files: Sequence[str] = ()) -> str:
    """Errors of a run by its log as JSON, in SI units; in the form of a summary.

    Args:
        study: The run.
        files: The files of the result, relative to its folder.
    """
    run, judged = study.plan.run, study.judged
    errors = [
        {"name": name, **_of_profile(error), "missed": asdict(missed)}
        for name, error, missed in study.contours
    ]
    data = {
        **_summary(study, files),
        "judged": {
            "run": run.name,
            **_fields(judged.runs[0]),
            "delay": judged.delay,
            "contour_error": _of_profile(study.profile),
            "contours": errors,
            "notes": study.notes,
        },
    }
    return to_json(data)


def _summary(study: LearningStudy | JudgedStudy, files: Sequence[str]) -> dict[str, Any]:
    """The summary of the plan from which is learned."""
    plans = Study(job=study.job, runs={study.plan.run.name: study.plan})
    page = plain(plans.to_data(files))
    return {**page, "units": page["units"] | LEARNING_UNITS}


def _of_profile(x: ErrorProfile) -> dict[str, float]:
    """Data of a contour error."""
    return {"rms": x.rms, "max": x.max, "t_max": x.t_max, "s_max": x.s_max}


def _fields(run: LearnedRun) -> dict[str, Any]:
    """Errors and clock of a run."""
    return {x.name: getattr(run, x.name) for x in fields(run) if x.name not in LEFT_OUT}
