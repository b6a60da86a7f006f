"""Short options and sliders of the keys of a job, from the annotations of their fields."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_type_hints

from armcontour.core.fields import parts_of
from armcontour.core.quantities import About, AtLeast, Quantity
from armcontour.core.text import capitalise, describe_fields
from armcontour.files.forms import FORMS, Form
from armcontour.files.job_edits import Keys
from armcontour.files.job_model import JobModel, RunModel
from armcontour.files.si_data import alternatives

# Topics in the help of commands, by the first key.
TOPICS = {
    "path": "Drawing",
    **dict.fromkeys(("limits", "corners", "process"), "Speed, corners and start"),
    "certificate": "Certificate",
    "placement": "Places",
}
# What a description has beyond a help: units, shapes, code, and sentences after the first.
MORE = re.compile(r"^Whether to | \[\S*\](, \(\w*,?\))?(?=[.,;:]?( |$))|`|\.( .*)?$")


def settings(of: type = JobModel, outer: Keys = ()) -> Iterator[tuple[Keys, About, Any, str]]:
    """Keys of a file that options or sliders set, with annotation and description.

    Args:
        of: The dataclass of the file.
        outer: The keys that lead there.
    """
    form, texts = FORMS.get(of, Form()), describe_fields(of)
    hints = get_type_hints(of, include_extras=True)
    for x in dataclasses.fields(of):
        if x.name in form.omit:
            continue
        keys, hint = (*outer, form.names.get(x.name, x.name)), hints[x.name]
        for about in getattr(hint, "__metadata__", ()):
            if isinstance(about, About):
                yield keys, about, hint, texts[x.name]
        for kind in alternatives(hint):
            if dataclasses.is_dataclass(kind) and isinstance(kind, type):
                yield from settings(kind, keys)


def usual_ranges() -> dict[Keys, tuple[float, float]]:
    """The usual ranges of the quantities of a job and its runs that have one, in SI units."""
    every = (x for of in (JobModel, RunModel) for x in settings(of))
    return {keys: about.usual for keys, about, *_ in every if about.usual[1]}


def options_text() -> str:
    """The short options as the JSON that the command line reads at its start, one a line."""
    rows = (json.dumps(_option(*x)) for x in settings() if x[1].option)
    return "[\n" + ",\n".join(rows) + "\n]\n"


def _option(keys: Keys, about: About, hint: Any, text: str) -> dict[str, Any]:
    """One short option: its name, what it sets, and how commands read it."""
    parts, read, example, more = tuple(parts_of(hint)), about.read, "", ""
    quantity = next((x for x in parts if isinstance(x, Quantity)), None)
    whole = next((x for x in parts if isinstance(x, AtLeast)), None)
    if bool in parts or read == "to_skip":
        kind = "flag"
    elif Mapping in parts or (Sequence in parts and not read):
        kind, more = "texts", "; may be repeated"
    elif quantity is not None and quantity.unit == "1":
        kind = "number"
    elif quantity is not None:
        kind, read, example = "text", "to_quantity", f", such as '{quantity.example}'"
    else:
        kind = "whole" if whole else "text"
    head, colon, rest = capitalise(MORE.sub("", text)).partition(";")
    return {
        "option": about.option,
        "key": ".".join(map(str, (*keys, about.key) if about.key else keys)),
        "topic": about.topic or TOPICS[str(keys[0])],
        "kind": kind,
        "read": read,
        "least": whole.least if whole else None,
        "help": about.help or f"{head}{example}{colon}{rest}{more}.",
    }
