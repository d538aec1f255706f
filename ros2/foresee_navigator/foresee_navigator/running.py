"""Running a node until the program is asked to end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from foresee.infra.errors import LineError
from foresee.mapping.conventions import TICK


def run(make: Callable[[], Node], args: list[str] | None) -> None:
    """Make a node, and spin it until the program is interrupted.

    A mistake in the settings is reported in one line, with exit status 2.

    Args:
        make: function or class that makes the node.
        args: command line; None: that of the program.
    """
    # The handlers of rclpy would close the topics before the node can stop the robot.
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node: Any = None
    try:
        node = make()
        _spin(node)
    except (ValueError, LineError) as error:
        if node is not None:
            raise
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: Node) -> None:
    """Spin a node until a signal asks the program to end; a second one interrupts it at once."""
    is_asked = False

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal is_asked
        if is_asked:
            raise KeyboardInterrupt
        is_asked = True

    # The node ends between two callbacks. Within one, an exception might be taken for a failure of
    # the predictor, and the node would go on; or it would come out of native code as another one.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok() and not is_asked:
            executor.spin_once(TICK)
    finally:
        executor.shutdown()
