"""Reads the MCAP files that tests write."""

from collections import defaultdict

import numpy as np
from rosbags.highlevel import AnyReader


def messages(path):
    """Topic → times [s] and messages, in the order of the file."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((1e-9 * time, message))
    return found


def cells(grid):
    """The cells of a grid, (rows, columns)."""
    return np.asarray(grid.data, np.int8).reshape(grid.info.height, grid.info.width)


def corner(grid):
    """x, y of the lower-left corner of a grid [m]."""
    return grid.info.origin.position.x, grid.info.origin.position.y


def part(grid, of):
    """The cells of a grid that another one covers as well, both (rows, columns)."""
    (x, y), (left, low) = corner(grid), corner(of)
    row, col = (round((b - a) / grid.info.resolution) for a, b in ((y, low), (x, left)))
    wide = np.pad(cells(grid), 400, constant_values=-1)
    rows, cols = cells(of).shape
    return wide[row + 400 : row + 400 + rows, col + 400 : col + 400 + cols], cells(of)
