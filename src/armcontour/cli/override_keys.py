"""Keys of the terminal that pause a motion, change its speed, or end it."""

from __future__ import annotations

import select
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

# Speeds that the keys - and + select, as fractions of the planned speed.
SPEEDS = (0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 0.75, 1.0)
# Speeds that differ by less are equal.
SAME_SPEED = 1e-9
# A key that comes again within this time is held, and counts once [s]. Terminals repeat a held key
# for the first time after up to 0.66 s.
HELD_TIME = 0.7
# Time between two looks for a key [s].
KEY_PERIOD = 0.05
HINT = (
    "Keys: space pauses, c pauses at the end of the contour, r goes on, - and + change the speed, "
    "q ends the motion on its path."
)


class OverrideKeys:
    """The wanted override, and whether the motion is to end, by the keys that were pressed.

    Args:
        speed: Override at the start.

    Attributes:
        ended: Set if the motion is to end.
    """

    def __init__(self, speed: float) -> None:
        self.ended = threading.Event()
        self._speed = speed
        self._is_paused = False
        self._pauses_after = False
        self._last_key = ""
        self._last_time = -HELD_TIME

    def __call__(self) -> float:
        """Return the wanted override; 0 while the motion is paused."""
        return 0.0 if self._is_paused else self._speed

    def pause_after(self) -> bool:
        """Return whether the motion pauses at the end of the contour."""
        return self._pauses_after

    def press(self, key: str, now: float) -> None:
        """Obey a key; other keys do nothing.

        Args:
            key: The character.
            now: Time of a clock [s].
        """
        is_held = key == self._last_key and now - self._last_time < HELD_TIME
        self._last_key = key
        self._last_time = now
        if key == " ":
            self._is_paused = True
        elif key == "c":
            self._pauses_after = True
        elif key == "r" and self._is_paused:
            # A pause that was wanted at the end of the contour remains wanted.
            self._is_paused = False
        elif key == "r" and not is_held:
            self._pauses_after = False
        elif key == "q":
            self.ended.set()
        elif key in ("+", "=") and not is_held:
            faster = [x for x in SPEEDS if x > self._speed + SAME_SPEED]
            self._speed = min(faster, default=self._speed)
        elif key == "-" and not is_held:
            slower = [x for x in SPEEDS if x < self._speed - SAME_SPEED]
            self._speed = max(slower, default=self._speed)

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Context in which a thread obeys the keys of the terminal."""
        if not sys.stdin.isatty():
            yield
            return
        is_over = threading.Event()
        listener = threading.Thread(target=self._listen, args=(is_over,), daemon=True)
        with _single_keys():
            listener.start()
            try:
                yield
            finally:
                is_over.set()
                listener.join()

    def _listen(self, is_over: threading.Event) -> None:
        """Obey keys until the motion is over."""
        while not is_over.is_set():
            key = _next_key()
            if key:
                self.press(key, time.monotonic())


if sys.platform == "win32":
    import msvcrt

    @contextmanager
    def _single_keys() -> Iterator[None]:
        """Context in which keys can be read one by one."""
        yield

    def _next_key() -> str:
        """Wait shortly for a key, and return it; "" if none was pressed."""
        time.sleep(KEY_PERIOD)
        return msvcrt.getwch() if msvcrt.kbhit() else ""

else:
    import os
    import termios
    import tty

    @contextmanager
    def _single_keys() -> Iterator[None]:
        """Context in which keys can be read one by one, and are not shown."""
        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)
        try:
            yield
        finally:
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)

    def _next_key() -> str:
        """Wait shortly for a key, and return it; "" if none was pressed."""
        terminal = sys.stdin.fileno()
        if not select.select([terminal], [], [], KEY_PERIOD)[0]:
            return ""
        return os.read(terminal, 1).decode(errors="ignore")
