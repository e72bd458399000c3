"""Signals that end a window: Ctrl+C in its terminal, a terminal that closes, `kill`."""

import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
PATIENCE = 0.8  # seconds that a frame may take to end after a signal


@contextmanager
def interrupts(end: Callable[[], object], wake: Callable[[], object]) -> Iterator[Callable[[], int]]:
    """Call `end` in the main thread when a signal asks the process to end; a second one, or no end, kills it.

    Python runs a handler only between two of its own steps, and a window sleeps in none of them: so a thread that
    the signal itself wakes calls `wake`. Outside the main thread nothing is done.

    Yields
    ------
    callable
        Returns the exit code that a shell expects, 128 and the number of the signal; 0 without one.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: 0
        return
    came: list[int] = []
    left = threading.Event()
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def handle(number: int, _: object) -> None:
        if came:
            os._exit(128 + number)
        came.append(number)
        end()

    def listen() -> None:
        while numbers := reader.recv(1):
            if numbers[0] in ENDING:
                wake()
                if not left.wait(PATIENCE):
                    os._exit(128 + numbers[0])

    before = {number: signal.signal(number, handle) for number in ENDING}
    descriptor = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=listen, name="interrupts", daemon=True).start()
    try:
        yield lambda: 128 + came[0] if came else 0
    finally:
        left.set()
        signal.set_wakeup_fd(descriptor)
        for number, handler in before.items():
            signal.signal(number, handler)
        writer.close()
