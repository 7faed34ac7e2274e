"""Delay Ctrl-C to safe points: in the middle of a transaction it would leave the storage locked."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType


class Interrupts:
    """A context in which Ctrl-C waits until the end, or until the next `passing` block.

    It has no effect outside the main thread, or if Ctrl-C is ignored.
    """

    def __init__(self) -> None:
        self._before: signal.Handlers | object = None
        self._came = False
        self._passing = False

    def __enter__(self) -> "Interrupts":
        if threading.current_thread() is threading.main_thread():
            self._before = signal.getsignal(signal.SIGINT)
        if callable(self._before):
            signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if callable(self._before):
            signal.signal(signal.SIGINT, self._before)
            if kind is None:
                self._raise()

    @contextmanager
    def passing(self) -> Iterator[None]:
        """Let Ctrl-C interrupt a long computation at any point.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed now or earlier, even if Python dropped the exception, as it
                does for exceptions raised in a callback of the garbage collector.
        """
        self._passing = True
        try:
            self._raise()
            yield
        finally:
            self._passing = False
        self._raise()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self._came = True
        if self._passing:
            raise KeyboardInterrupt

    def _raise(self) -> None:
        if self._came:
            raise KeyboardInterrupt
