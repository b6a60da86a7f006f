"""Results of tasks: the state of the job they were made for, what has changed since, and frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from threading import Lock
from typing import Any

from armcontour.core.source_file import SourceFile
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.differences import differences

# Maximum number of results whose origin is kept; pages show fewer.
MAX_ORIGINS = 50
# Maximum number of results that a page receives when it joins; pages show as many.
MAX_RESULTS = 12
# Kinds of frames that end a task.
ENDINGS = ("result", "failed", "cancelled")
# Difference after the files of a job, such as its drawing, were read again.
READ_AGAIN = "Files read again"


@dataclass(frozen=True, slots=True)
class Origin:
    """The state of the job for which a task was started.

    Args:
        task: Name of the task.
        data: Data of the job.
        run: Name of the run.
        made: Facts for users: time, name of the job, run, and files with their fingerprints.
        reread: Whether the files of the job were read again since.
    """

    task: str
    data: Mapping[str, Any]
    run: str
    made: Mapping[str, str]
    reread: bool = False

    def changes_until(self, data: Mapping[str, Any]) -> list[str]:
        """Describe the changes of the job since the task was started."""
        changed = differences(self.data, data)
        return [*changed, READ_AGAIN] if self.reread else changed


class Origins:
    """Origins of the newest results, by identifier of the task."""

    def __init__(self) -> None:
        self._origins: dict[str, Origin] = {}

    def keep(
        self, id: str, task: str, data: Mapping[str, Any], run: str, files: Sequence[SourceFile]
    ) -> str:
        """Keep the state for which a task is started; above the limit, drop the oldest.

        Returns the facts of the result in one line, for its file.

        Args:
            id: Identifier of the task.
            task: Name of the task.
            data: Data of the job.
            run: Name of the run.
            files: The job's text and its drawing.
        """
        made = {
            "time": datetime.now().isoformat(" ", "minutes"),
            "job": str(data.get("name") or "job"),
            "run": run,
            "files": ", ".join(f"{x.name} {x.fingerprint}" for x in files),
        }
        self._origins[id] = Origin(task, data, run, made)
        while len(self._origins) > MAX_ORIGINS:
            del self._origins[next(iter(self._origins))]
        return f"{made['time']}, job {made['job']}, run {run}, SHA-256: {made['files']}"

    def made(self, id: Any) -> Mapping[str, str] | None:
        """Return the facts of a result for users; None for an unknown task."""
        origin = self._origins.get(id)
        return None if origin is None else origin.made

    def renew(self, id: Any, data: Mapping[str, Any]) -> None:
        """Let a result apply to the job that has the change which the result offers."""
        if id in self._origins:
            self._origins[id] = replace(self._origins[id], data=data)

    def read_again(self) -> None:
        """Mark all results as older than the files of the job."""
        self._origins = {id: replace(x, reread=True) for id, x in self._origins.items()}

    def changes_until(self, data: Mapping[str, Any]) -> dict[str, list[str]]:
        """Describe for each result what has changed since; results without a change are omitted."""
        changed = {id: x.changes_until(data) for id, x in self._origins.items()}
        return {id: x for id, x in changed.items() if x}

    def clear(self) -> None:
        """Forget all results, because another document is opened."""
        self._origins.clear()


@dataclass(frozen=True, slots=True)
class TaskFrames:
    """Frames of a task that a page needs to show the result.

    Args:
        started: Frame that the task was started, with its options.
        ended: Frame with which the task has ended; None while it runs.
    """

    started: MessageFrame
    ended: MessageFrame | None = None


class TaskResults:
    """Frames of the newest tasks, for pages that join later; thread-safe.

    Args:
        send: Function that sends a frame to all pages.
    """

    def __init__(self, send: Callable[[MessageFrame], None]) -> None:
        self._send = send
        self._lock = Lock()
        self._tasks: dict[str, TaskFrames] = {}

    def begin(
        self, id: str, task: str, options: Mapping[str, Any], made: Mapping[str, str] | None
    ) -> None:
        """Report to all pages that a task is started; above the limit, drop the oldest.

        Args:
            id: Identifier of the task.
            task: Name of the task.
            options: Options of the task.
            made: Facts of the result for users, see `Origin`.
        """
        header = {"id": id, "task": task, "options": dict(options), "made": made}
        with self._lock:
            self._tasks[id] = TaskFrames(MessageFrame("started", header))
            while len(self._tasks) > MAX_RESULTS:
                del self._tasks[next(iter(self._tasks))]
            self._send(self._tasks[id].started)

    def take(self, frame: MessageFrame) -> None:
        """Keep a frame that ends a task, and send a task's frame to all pages."""
        with self._lock:
            id = frame.header.get("id")
            if frame.kind in ENDINGS and id in self._tasks:
                self._tasks[id] = replace(self._tasks[id], ended=frame)
            self._send(frame)

    def show(self, send: Callable[[MessageFrame], None]) -> None:
        """Send all kept results, the oldest first.

        Args:
            send: Function that sends a frame to the page that joins.
        """
        # Without the lock, the page could receive the end of a task before its start.
        with self._lock:
            for frames in self._tasks.values():
                send(frames.started)
                if frames.ended is not None:
                    send(frames.ended)

    def clear(self) -> None:
        """Forget all results, because another document is opened."""
        with self._lock:
            self._tasks.clear()
