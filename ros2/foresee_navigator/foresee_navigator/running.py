"""Running a node until the program is asked to end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from foresee.infra.errors import LineError


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
        rclpy.spin(node)
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
