"""The name of a figure's file: it tells what was chosen, so that none replaces another."""

from __future__ import annotations


def file_name(kind: str, ending: str, episode: int | None = None, arm: str | None = None) -> str:
    """Return the name of a file, such as moment.png, moment-3.png or drive-3-predicted-2.gif.

    Args:
        kind: what the figure shows, such as "moment".
        ending: file type, such as "png".
        episode: number of the episode that was chosen; None: the figure chooses.
        arm: arm that was chosen, such as "predicted 2 %"; None: the figure chooses.
    """
    words = kind if episode is None else f"{kind} {episode}"
    words = words if arm is None else f"{words} {arm.removesuffix(' %')}"
    return f"{words.replace(' ', '-')}.{ending}"
