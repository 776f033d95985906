"""Requests of the console, done one at a time by a thread of their own."""
import queue
import threading
import time
import traceback
from dataclasses import dataclass

from cortshift_tracking.errors import CortshiftError


class DeskError(CortshiftError):
    """A request that cannot be fulfilled; the message says why and what to do."""


@dataclass
class Activity:
    """The request under way, or the last one."""
    what: str = 'nothing yet'
    busy: bool = False
    success: bool = True
    message: str = ''
    started: float = 0.0
    expected: float = 0.0  # s
    summary: tuple = ()


class Worker:
    """Takes a request while none is under way. Nothing that a request raises ends it."""

    def __init__(self, log=print):
        """log: takes the text of a fault that no request should have."""
        self._lock = threading.Lock()
        self._activity = Activity()
        self._requests = queue.Queue()
        self._log = log
        threading.Thread(target=self._serve, daemon=True).start()

    def ask(self, what, expected, work, *arguments):
        """work(*arguments) in the worker's thread: returns (message, summary lines), or raises DeskError.

        expected: how long it should take [s]. Returns at once; DeskError where another request is under way.
        """
        with self._lock:
            if self._activity.busy:
                raise DeskError(f'{self._activity.what} is still under way; try again when it is done')
            self._activity = Activity(what, True, started=time.monotonic(), expected=expected)
        self._requests.put((work, arguments))

    @property
    def activity(self):
        with self._lock:
            return self._activity

    def progress(self):
        """Share of the request under way that should be done by now, 0-1; it never says that all is done before it is."""
        activity = self.activity
        if not activity.busy:
            return 1.0
        return min(0.95, (time.monotonic() - activity.started) / max(activity.expected, 0.1))

    def _serve(self):
        while True:
            work, arguments = self._requests.get()
            try:
                message, summary = work(*arguments)
                success = True
            except DeskError as error:
                success, message, summary = False, str(error), ()
            except Exception as error:  # whatever it is, the next request must find a worker
                self._log(f'{self.activity.what}: {traceback.format_exc()}')
                success, summary = False, ()
                message = f'{self.activity.what} failed by a fault of the console ({type(error).__name__}: {error}); see its log, and report it'
            with self._lock:
                self._activity = Activity(self._activity.what, False, success, message, summary=summary)
