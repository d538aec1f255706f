"""Settings from the parameters of a node."""

from __future__ import annotations

from dataclasses import fields
from typing import TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from foresee_navigator.settings import Settings, described

S = TypeVar("S", bound=Settings)
"""Type of the settings."""


def declared(node: Node, kind: type[S]) -> S:
    """Declare the parameters of a node, and return their values as settings.

    They are read once: the node must be started again after a change.

    Args:
        node: node that is being made.
        kind: class of the settings.

    Raises:
        ValueError: if a value is not allowed.
    """
    values = {}
    for setting in fields(kind):
        about = ParameterDescriptor(description=described(setting), read_only=True)
        # An integer in a file stands for a number, too.
        about.dynamic_typing = isinstance(setting.default, float)
        value = node.declare_parameter(setting.name, setting.default, about).value
        kind_of_value = type(setting.default)
        if isinstance(setting.default, float) and type(value) is int:
            value = float(value)
        if type(value) is not kind_of_value:
            raise ValueError(
                f"{setting.name} is {value!r}, it must be of type {kind_of_value.__name__}"
            )
        values[setting.name] = value
    return kind(**values)
