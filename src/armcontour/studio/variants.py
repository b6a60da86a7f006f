"""Variants of a job: its runs, and pins, which are states that a person wants to compare with."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, fields
from typing import Any

from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.job_edits import Change
from armcontour.io.job_model import JobModel, RunModel

MOST_PINS = 50
# Keys that a run can have in the place of the job's.
SHARED = tuple(x.name for x in fields(RunModel) if x.name in {y.name for y in fields(JobModel)})
# Keys that say nothing of a motion.
WORDS = ("name", "title", "runs", "certificate", "placement")


@dataclass(slots=True)
class Pin:
    """A state of the document.

    Args:
        number: Its number.
        name: Its name.
        text: Text of the job.
        data: The same as parsed.
        run: Name of its run.
        duration: Duration of the run [s]; None if unknown.
        rms: Root mean square of its contour error [m]; None if unknown.
        max: The largest contour error [m]; None if unknown.
    """

    number: int
    name: str
    text: str
    data: Mapping[str, Any]
    run: str
    duration: float | None = None
    rms: float | None = None
    max: float | None = None


class Variants:
    """Pins, and what the document is compared with."""

    def __init__(self) -> None:
        self.pins: list[Pin] = []
        self._count = 0
        # A pin, or the name of a run.
        self._against: Pin | str | None = None

    @property
    def header(self) -> dict[str, Any]:
        """Pins and comparison, for a frame."""
        against = self._against
        return {
            "pins": [
                {
                    **{"pin": x.number, "name": x.name, "run": x.run},
                    **{"duration": x.duration, "rms": x.rms, "max": x.max},
                }
                for x in self.pins
            ],
            "compare": {"pin": against.number}
            if isinstance(against, Pin)
            else None
            if against is None
            else {"run": against},
        }

    @property
    def compared(self) -> tuple[Mapping[str, Any] | None, str | None]:
        """Job and run that the document is compared with; no job for that of the document."""
        if isinstance(self._against, Pin):
            return self._against.data, self._against.run
        return None, self._against

    def pin(
        self,
        text: str,
        data: Mapping[str, Any],
        run: str,
        figures: Mapping[str, Any],
        *,
        name: str | None,
    ) -> Pin:
        """Keep a state.

        Args:
            text: Text of the job.
            data: The same as parsed.
            run: Name of the run.
            figures: Duration and error, as of `Pin`.
            name: Name of the pin; by default its number.

        Raises:
            InvalidInput: There are many already.
        """
        if len(self.pins) >= MOST_PINS:
            raise InvalidInput(f"There are {MOST_PINS} pins already: remove some.")
        self._count += 1
        pin = Pin(self._count, (name or f"Pin {self._count}")[:MOST_PINS], text, data, run)
        self.pins.append(pin)
        _set_figures(pin, figures)
        return pin

    def find(self, number: Any) -> Pin:
        """The pin of a number.

        Raises:
            InvalidInput: There is none.
        """
        found = next((x for x in self.pins if x.number == number), None)
        if found is None:
            raise InvalidInput(f"There is no pin {show(number)}.")
        return found

    def unpin(self, number: Any) -> None:
        """Remove a pin.

        Raises:
            InvalidInput: There is none of that number.
        """
        pin = self.find(number)
        self.pins.remove(pin)
        if self._against is pin:
            self._against = None

    def replace(
        self, pin: Pin, text: str, data: Mapping[str, Any], run: str, figures: Mapping[str, Any]
    ) -> None:
        """Let a pin keep another state; arguments as of `pin`."""
        pin.text, pin.data, pin.run = text, data, run
        _set_figures(pin, figures)

    def compare(self, against: Any, data: Mapping[str, Any]) -> None:
        """Compare the document with a pin, a run or nothing.

        Args:
            against: {"pin": number}, {"run": name} or None.
            data: The job of the document.

        Raises:
            InvalidInput: There is no such pin or run.
        """
        if against is None:
            self._against = None
        elif isinstance(against, Mapping) and "pin" in against:
            self._against = self.find(against["pin"])
        elif isinstance(against, Mapping) and against.get("run") in list(data.get("runs") or {}):
            self._against = against["run"]
        else:
            raise InvalidInput(f"There is nothing to compare with: {show(against)}.")

    def keep_to(self, data: Mapping[str, Any]) -> None:
        """End a comparison with a run that the job does not have any more."""
        if isinstance(self._against, str) and self._against not in (data.get("runs") or {}):
            self._against = None

    def learn(self, request: Mapping[str, Any], figures: Mapping[str, Any]) -> bool:
        """Take exact figures for the pins that they are of; returns whether there are some."""
        pins = [
            x for x in self.pins if x.text == request.get("text") and x.run == request.get("run")
        ]
        for pin in pins:
            _set_figures(pin, figures)
        return bool(pins)


def add_run(data: Mapping[str, Any], name: str, like: Any) -> list[Change]:
    """Changes that add a run.

    Args:
        data: The job.
        name: Name of the new run.
        like: Name of the run that it is a copy of.

    Raises:
        InvalidInput: The name is taken, or there is no run to copy.
    """
    runs = data.get("runs") or {}
    if name in runs:
        raise InvalidInput(f"The job has a run {name} already.")
    if like not in list(runs):
        raise InvalidInput(f"The job has no run {show(like)}.")
    return [Change(("runs", name), deepcopy(runs[like]))]


def remove_run(data: Mapping[str, Any], name: str) -> list[Change]:
    """Changes that remove a run, and what names it.

    Args:
        data: The job.
        name: Name of the run.

    Raises:
        InvalidInput: There is no such run, or no other one.
    """
    runs = data.get("runs") or {}
    if name not in runs:
        raise InvalidInput(f"The job has no run {name}.")
    if len(runs) == 1:
        raise InvalidInput(f"{name} is the only run, and a job needs one.")
    changes, experiment = [Change(("runs", name))], data.get("experiment") or {}
    if name in (experiment.get("runs") or []):
        changes.append(Change(("experiment", "runs", experiment["runs"].index(name))))
    for key in ("certificate", "placement"):
        if (data.get(key) or {}).get("run") == name:
            changes.append(Change((key, "run")))
    return changes


def pin_to_run(data: Mapping[str, Any], pin: Pin, name: str) -> list[Change]:
    """Changes that make a pin a run of the job.

    Args:
        data: The job.
        pin: The pin.
        name: Name of the new run.

    Raises:
        InvalidInput: The name is taken, or the pin differs in what all runs of a job share.
    """
    if name in (data.get("runs") or {}):
        raise InvalidInput(f"The job has a run {name} already.")
    run = dict(pin.data["runs"][pin.run] or {})
    other = [
        x
        for x in {**data, **pin.data}
        if x not in (*WORDS, *SHARED) and data.get(x) != pin.data.get(x)
    ]
    for key in SHARED:
        mine, its = data.get(key), pin.data.get(key)
        if isinstance(its, Mapping) and isinstance(mine, Mapping | None) and key == "limits":
            before = mine or {}
            if set(before) - set(its):
                other.append(key)
            differs = {x: y for x, y in its.items() if x not in before or before[x] != y}
            if differs:
                run[key] = {**differs, **(run.get(key) or {})}
        elif mine != its and key not in run:
            if its is None:
                other.append(key)
            run[key] = its
    if other:
        raise InvalidInput(
            f"{pin.name} differs in {', '.join(other)}, which all runs of a job share: swap with "
            "it, or save it as a job of its own."
        )
    return [Change(("runs", name), deepcopy(run))]


def _set_figures(pin: Pin, figures: Mapping[str, Any]) -> None:
    """Set duration and errors of a pin."""
    pin.duration, pin.rms = figures.get("duration"), figures.get("rms")
    pin.max = figures.get("max")
