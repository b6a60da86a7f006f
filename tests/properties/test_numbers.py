"""No number in a job breaks the program: what is decided before work starts, in all fields.

`make soak` runs all of them to their end.
"""

import itertools
import re
import warnings
from functools import cache

import pytest
import yaml
from tests.properties.number_cases import FILES, HOSTILE, NEVER, base_of, fields, put, shown

from armcontour import ArmContourError
from armcontour.files import parse_job

FIELDS = fields()
# libyaml's writer, ten times as fast, where PyYAML has it.
DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
# Half a million arcs are made before that is refused.
SLOW = [("path.spline.points.0.0", "1e9")]
MAY_BE_ENDLESS = {"limits", "command_limits", "kp", "kv", "acceleration_limit"}


# Refusals without the key: they name the file, the run, or an option.
WITHOUT_KEY = (
    "job: Run one: At its assigned velocities",
    "robot.urdf has no arguments",
    "part.svg",
    "box.step",
    "job: scale must",
    "job: Segment 3 starts at (40000000.0",
    "job: chord tolerance must be at least 1e-30",
    "job: join tolerance must be at least 1e-30",
)


def write_files(folder):
    for name, data in FILES.items():
        (folder / name).write_bytes(data)


def read(job, folder):
    """The sentence that a job is refused with; None if it is read."""
    return read_text(yaml.dump(job, Dumper=DUMPER), folder)


@cache
def read_text(text, folder):
    """The same of its text; many fields share one job without hostile numbers."""
    try:
        # Of a library's warnings, pytest makes errors.
        parse_job(text, folder=folder)
    except ArmContourError as error:
        return str(error)
    return None


def test_the_number_fields_of_jobs_are_found_in_the_schema():
    assert len(FIELDS) >= 142
    for place in [("servo", "kp"), ("servo", "kp", 0), ("runs", "*", "timing", "reserve")]:
        assert place in FIELDS


def check_field(place, words, folder):
    """Faults of a field: a hostile number is read, or refused with one sentence."""
    base = base_of(place)
    if (read(base, folder) is None) != (place not in NEVER):
        yield f"{shown(place)}: the job without a hostile number"
    for word in words:
        if (shown(place), word) in SLOW:
            continue
        message = read(put(base, place, HOSTILE[word]), folder)
        if message is not None:
            key = re.search(rf"\b{place[0].replace('_', '[_ ]')}[.: ]", message)
            if "\n" in message or not (key or any(x in message for x in WITHOUT_KEY)):
                yield f"{shown(place)}: {word}: {message}"
        # Values that are not finite numbers are refused in every field, except text in fields of
        # text, and infinity that disables a limit or a delay. Both ends of a range may be infinite
        # with either sign, and a lower bound may be -inf.
        elif word == "-inf" and (
            set(place) & {"joint_lower", "joint_upper"}
            or (set(place) & MAY_BE_ENDLESS and place[-2:] == (0, 0))
        ):
            continue
        elif word in ("nan", "-inf") or (word == "inf" and not set(place) & MAY_BE_ENDLESS):
            yield f"{shown(place)}: {word} is read"


def test_every_number_is_read_or_refused_with_one_sentence(tmp_path):
    with pytest.raises(RuntimeWarning):  # warnings are errors here
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    # One of the hostile numbers for each field, in turn.
    write_files(tmp_path)
    words = itertools.cycle(HOSTILE)
    faults = list[str]()
    for place in FIELDS:
        faults += check_field(place, itertools.islice(words, 1), tmp_path)
    assert faults == []
