"""The watchdog: which inputs are missing or late."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Arrival:
    """The newest message of an input.

    Attributes:
        time: when it arrived, on a clock that never stops [s].
        stamp: its stamp, on the clock of the node [s].
    """

    time: float
    stamp: float


class Watchdog:
    """Says which inputs are missing or late.

    Two clocks are needed: one that goes on when the simulator that publishes /clock has ended, and
    the clock of the node, which the stamps are read from.

    Args:
        inputs: names of the inputs.
        timeout: longest time from message to message, and greatest age of a message [s].
    """

    def __init__(self, inputs: tuple[str, ...], timeout: float) -> None:
        self._timeout = timeout
        self._newest: dict[str, Arrival | None] = dict.fromkeys(inputs)

    def saw(self, name: str, arrival: Arrival) -> None:
        """Note that a message has arrived.

        Raises:
            KeyError: if there is no such input.
        """
        if name not in self._newest:
            raise KeyError(f"{name!r} is no input, they are {', '.join(self._newest)}")
        self._newest[name] = arrival

    def complaints(self, time: float, clock: float) -> tuple[str, ...]:
        """Return a line for each input that is missing or late; () if all are there.

        Args:
            time: present time on the clock that never stops [s].
            clock: present time on the clock of the node [s].
        """
        lines = (self._complaint(name, time, clock) for name in self._newest)
        return tuple(line for line in lines if line)

    def _complaint(self, name: str, time: float, clock: float) -> str:
        newest = self._newest[name]
        if newest is None:
            return f"no {name} yet"
        silent, age = time - newest.time, clock - newest.stamp
        if silent > self._timeout:
            return f"no {name} for {silent:.1f} s"
        if age > self._timeout:
            return f"{name} is {age:.1f} s late"
        if age < -self._timeout:
            return f"{name} is stamped {-age:.1f} s ahead of this node's clock"
        return ""
