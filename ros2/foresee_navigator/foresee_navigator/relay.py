"""The relay: sends what was kept while a decision is late."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from threading import Event, Thread
from types import TracebackType

from foresee.mapping.commands import TwistCommand
from foresee.mapping.conventions import TICK


class Relay:
    """Sends a command at the end of each tick until a decision is there.

    It is a context in which the decision is made. A thread sends the commands.

    Args:
        send: sends a command.
        commands: commands of the coming ticks.
        tick: length of a tick [s].

    Attributes:
        sent: number of commands that were sent; final when the context has ended.
    """

    def __init__(
        self,
        send: Callable[[TwistCommand], None],
        commands: Sequence[TwistCommand],
        tick: float = TICK,
    ) -> None:
        self.sent = 0
        self._send, self._commands, self._tick = send, commands, tick
        self._decided = Event()
        self._thread = Thread(target=self._run, args=(time.monotonic(),), daemon=True)

    def __enter__(self) -> Relay:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._decided.set()
        self._thread.join()

    def _run(self, started: float) -> None:
        for number, command in enumerate(self._commands, start=1):
            if self._decided.wait(max(0.0, started + number * self._tick - time.monotonic())):
                return
            self._send(command)
            self.sent += 1
