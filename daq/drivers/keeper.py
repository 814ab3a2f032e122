"""A thread per device that takes care of it: tried again by itself, with back-off, and never in another one's way."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from daq.frames.clock import NS

#: Pauses after so many failures in a row. The longest one, with the time that an attempt takes, is what a device that
#: is back may have to wait for: it is kept below the two seconds within which its values have to be there again.
BACK_OFF_S = (0.25, 0.5, 1.0)
STOP_TIMEOUT_S = 3.0
LOOK_S = 0.5  # at most between two looks at the clock while something is due


class Keeper:
    """Calls ``care`` in a thread of its own whenever it is due.

    Parameters
    ----------
    care : what is to be done; may take long. It asks again (:meth:`later`) if it did not succeed, or says
        :meth:`settled`.
    broke : told of an exception that ``care`` let out; it is a bug or a frame nobody thought of, never the keeper's end
    monotonic_ns : the clock that pauses are measured with
    pauses : s, after so many failures in a row
    """

    def __init__(
        self,
        name: str,
        care: Callable[[], None],
        broke: Callable[[Exception], None],
        monotonic_ns: Callable[[], int],
        pauses: Sequence[float] = BACK_OFF_S,
    ) -> None:
        self._care = care
        self._broke = broke
        self._monotonic_ns = monotonic_ns
        self._pauses = pauses
        self._condition = threading.Condition()
        self._due: int | None = None
        self._attempts = 0
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._started = False

    @property
    def stopping(self) -> bool:
        """Whether whatever takes long should give up."""
        return self._stopping

    def paused(self, seconds: float) -> bool:
        """Let time pass; return True if the keeper was stopped meanwhile."""
        with self._condition:
            return self._condition.wait_for(lambda: self._stopping, seconds)

    def start(self) -> None:
        """Start the thread; nothing is due yet."""
        self._started = True
        self._thread.start()

    def soon(self) -> None:
        """Care now: something happened that makes a new attempt worthwhile."""
        with self._condition:
            self._attempts = 0
            self._due = self._monotonic_ns()
            self._condition.notify()

    def later(self) -> None:
        """Schedule care after the back-off, unless it is due already."""
        with self._condition:
            if self._due is not None:
                return
            pause = self._pauses[min(self._attempts, len(self._pauses) - 1)]
            self._attempts += 1
            self._due = self._monotonic_ns() + round(pause * NS)
            self._condition.notify()

    def settled(self) -> None:
        """Reset: nothing is due, and the next failure is a first one."""
        with self._condition:
            self._due, self._attempts = None, 0

    def stop(self) -> None:
        """End the thread."""
        with self._condition:
            self._stopping = True
            self._condition.notify()
        if self._started and threading.current_thread() is not self._thread:
            self._thread.join(timeout=STOP_TIMEOUT_S)

    def _run(self) -> None:
        while True:
            with self._condition:
                if self._stopping:
                    return
                if self._due is None:  # whoever makes something due says so: looking now and then costs 0.3 % of a core
                    self._condition.wait()
                    continue
                if (wait := (self._due - self._monotonic_ns()) / NS) > 0:
                    self._condition.wait(min(LOOK_S, wait))
                    continue
                self._due = None
            try:
                self._care()
            except Exception as error:  # whatever it is costs this attempt, not the device for good
                self._broke(error)
                self.later()
