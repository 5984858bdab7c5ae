"""Signals, and the end of Python, while C++ has called Python back.

What a handler raises there, such as KeyboardInterrupt, is lost, or ends the process. Python ends a
thread where it next needs the interpreter: below C++ this aborts the process.
"""

from __future__ import annotations

import atexit
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

_NUMBERS: Final = tuple(signal.valid_signals())
_held: list[BaseException] | None = None  # in a block of the main thread
_inside: Final = set[threading.Thread]()  # other threads in a block
_leaving: Final = list[BaseException]()  # once Python ends

MAX_EXIT_SECONDS: Final = 10.0
"""How long a block may delay the end of Python."""


@contextmanager
def hold_interrupts() -> Iterator[list[BaseException]]:
    """Raise what handlers of signals raise in a block at its end; yield the list of it.

    The handlers are called at once. Python calls them in the main thread alone.
    """
    global _held
    if threading.current_thread() is not threading.main_thread():
        yield []
        return
    if _held is not None:
        yield _held
        return
    held = list[BaseException]()
    replaced = []
    try:
        _held = held
        for number in _NUMBERS:
            handler = signal.getsignal(number)
            if callable(handler):
                replaced.append((number, handler, _Holder(handler)))
                signal.signal(number, replaced[-1][-1])
        yield held
    finally:
        _held = None
        for number, handler, holder in replaced:
            if signal.getsignal(number) is holder:  # nobody else has set another one
                signal.signal(number, handler)
        if held:
            # Frames and the list would keep OMPL's objects, and it reports them as Python ends.
            del held[1:]
            raise held.pop().with_traceback(None)


@contextmanager
def hold_exit() -> Iterator[list[BaseException]]:
    """Hold interrupts in a block, and the end of Python; yield the list, which ends the block.

    In another thread than the main one, the list is filled when Python ends.
    """
    thread = threading.current_thread()
    if thread is threading.main_thread():
        with hold_interrupts() as held:
            yield held
        return
    _inside.add(thread)
    try:
        if _leaving:  # Python has not waited for this block
            _inside.discard(thread)
            threading.Event().wait()
        yield _leaving
    finally:
        _inside.discard(thread)


@atexit.register
def _leave() -> None:
    """End the blocks of other threads."""
    _leaving.append(SystemExit())
    end = time.monotonic() + MAX_EXIT_SECONDS
    with hold_interrupts():
        while any(thread.is_alive() for thread in tuple(_inside)) and time.monotonic() < end:
            time.sleep(0.001)


class _Holder:
    """A handler of a signal that holds back what another one raises."""

    def __init__(self, handler: Callable[[int, Any], object]) -> None:
        self._handler = handler

    def __call__(self, number: int, frame: Any) -> None:
        """Call the handler."""
        try:
            self._handler(number, frame)
        except BaseException as error:
            if _held is None:
                raise
            _held.append(error)
