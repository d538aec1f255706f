"""The compact network: from the observed part of a map to probabilities for the rest.

It is a residual U-Net (Ronneberger et al. 2015; He et al. 2016) on patches of 5 × 5 cells. Near the
frontier, single cells matter (a wall continues where it ended); farther away, the layout of the
building matters, for which 0.25 m is fine enough. Patches keep the single cells in their channels,
and make the layout cheap to compute. The same weights serve every size of map.

The context, a coarse map of 40 m, shows the kind of building, and what lies beyond the square. Its
features are added to those of stage 3, which have the same resolution of 1 m.

    known (B, 2, H, W)                            observed free, observed occupied
      patches       (B, 50,  H/5,  W/5)
      stage 1       (B, 32,  H/5,  W/5)   ─────────────┐
      stage 2       (B, 64,  H/10, W/10)  ──────────┐  │
      stage 3       (B, 112, H/20, W/20)  ───────┐  │  │       context (B, 2, 80, 80) is added here
      stage 4       (B, 128, H/40, W/40)  ── up ─┴──┴──┴─▶ (B, 32, H/5, W/5)
    logits (B, 4, H, W)                           free, occupied, hidden; room

A linear layer on a summary of the context classifies the building, because predictions are wrong
more often in some kinds of building than in others.

With known ranges of their inputs, all convolutions but those of the context compute in 8-bit
integers. The context decides the doubt, which small changes of it would change by large factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from predictor.networks.quantised_conv import convolutions, quantise

FREE, OCCUPIED, HIDDEN, ROOM = range(4)
"""Channels of the output: three exclusive classes, and one separate probability."""
ROOM_REACH = 3
"""Half the width of the square of ROOM [cells], without the middle cell: a cell has room if the
square around it is free, which is 0.35 m wide, the width of a car plus one cell."""
MOST_DOUBT = 1e6
"""Upper bound of the doubt in each kind of building."""
LIKELY = 0.4
"""Probability of a kind of building from which on its whole doubt is used. Below, the logarithm of
the doubt is scaled by probability / LIKELY."""
STAGE = 2
"""Number of the stage, counted from 0, that the features of the context are added to."""


@dataclass(frozen=True)
class CompactConfig:
    """Shape of the network.

    Attributes:
        patch: side of a patch [cells].
        widths: channels of each stage; the resolution halves from one to the next.
        blocks: number of residual blocks of each stage of the encoder. The finest stage has one in
            the decoder only: a second would take a sixth of the time with 1 % of the weights.
        context: channels of the finest stage of the context's network; 0: no context.
        outputs: channels of the output.
        kinds: names of the kinds of building that it classifies by the context; empty: none.
        quantised: whether it computes in 8-bit integers, once it is `folded`.
    """

    patch: int = 5
    widths: tuple[int, ...] = (32, 64, 112, 128)
    blocks: tuple[int, ...] = (0, 1, 1, 2)
    context: int = 0
    outputs: int = 4
    kinds: tuple[str, ...] = ()
    quantised: bool = False

    @property
    def multiple(self) -> int:
        """Sides of the input must be a multiple of this [cells]."""
        return int(self.patch * 2 ** (len(self.widths) - 1))

    @classmethod
    def of(cls, fields: dict[str, Any]) -> CompactConfig:
        """Return the shape that the header of a file of weights describes.

        Raises:
            ValueError: if no network can have this shape.
            KeyError: if a field is missing.
            TypeError: if a field is of the wrong type.
        """
        widths, blocks = tuple(fields["widths"]), tuple(fields["blocks"])
        context, outputs = fields.get("context", 0), fields.get("outputs", 4)
        kinds = fields.get("kinds", ())
        if isinstance(kinds, str) or len(kinds) != len(set(kinds)):
            raise ValueError(f"the kinds of building are {kinds!r}, they must be different names")
        kinds = tuple(kinds)
        quantised = fields.get("quantised", False)
        config = cls(fields["patch"], widths, blocks, context, outputs, kinds, quantised)
        sizes, blocks = (config.patch, *widths, outputs), (*config.blocks, context)
        sane = all(isinstance(n, int) and 0 < n <= 1024 for n in sizes)
        sane &= all(isinstance(n, int) and 0 <= n <= 64 for n in blocks)
        sane &= not config.context or (len(widths) > STAGE + 1 and config.patch == 5)
        sane &= all(isinstance(kind, str) for kind in kinds) and len(kinds) <= 64
        sane &= (bool(context) or not kinds) and isinstance(quantised, bool)
        if not sane or len(config.widths) != len(config.blocks) or not 1 < len(config.widths) < 9:
            raise ValueError(f"no network is shaped like {config}")
        return config


class Block(nn.Module):
    """A residual block: x + two 3 × 3 convolutions."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = Conv(width, width)
        self.second = Conv(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """Return features (B, C, H, W) for features of the same shape."""
        return F.relu(x + self.second(F.relu(self.first(x))))


class Conv(nn.Module):
    """A 3 × 3 convolution with batch normalisation, which `CompactNet.folded` merges into it."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3, padding=1, bias=False)
        self.norm: nn.Module = nn.BatchNorm2d(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """Return (B, outputs, H, W) for (B, inputs, H, W)."""
        out: Tensor = self.norm(self.conv(x))
        return out

    def fold(self) -> None:
        """Merge the normalisation into the convolution, for inference only."""
        if isinstance(self.norm, nn.BatchNorm2d):
            self.conv = fuse_conv_bn_eval(self.conv, self.norm)
            self.norm = nn.Identity()


class ContextNet(nn.Module):
    """The network of the context: a small U-Net, and one vector for the whole context.

    Args:
        width: channels of the finer of its two stages, whose cells are 2 m wide.
        outputs: channels of the returned features.
    """

    def __init__(self, width: int, outputs: int) -> None:
        super().__init__()
        self.stem = Conv(32, width)
        self.fine = Block(width)
        self.down = nn.Conv2d(width, 2 * width, 2, 2)
        self.coarse = Block(2 * width)
        self.up = nn.ConvTranspose2d(2 * width, width, 2, 2)
        self.decode = Block(width)
        self.here = nn.ConvTranspose2d(width, outputs, 2, 2)
        self.everywhere = nn.Conv2d(2 * width, outputs, 1)
        for last in (self.here, self.everywhere):
            # Zero at first, so that adding a context to a trained network does not change it.
            for parameter in last.parameters():
                nn.init.zeros_(parameter)

    def forward(self, context: Tensor, rows: int, cols: int) -> tuple[Tensor, Tensor]:
        """Return features of the square around the robot, and a summary of the whole context.

        The features (B, outputs, rows, cols) lie on cells of 1 m; the summary is (B, 4 · width).

        Args:
            context: shares in [0, 1] observed free, and observed occupied, (B, 2, CELLS, CELLS).
            rows: rows of the square around the robot, an even number.
            cols: columns of that square, an even number.
        """
        fine = self.fine(F.relu(self.stem(F.pixel_unshuffle(context, 4))))
        coarse = self.coarse(F.relu(self.down(fine)))
        detail = _around(_around(self.up(coarse) + fine, rows, 2), cols, 3)
        here = self.here(self.decode(detail))
        mean = coarse.mean(dim=(2, 3), keepdim=True)
        features = _middle(_middle(here, rows, 2), cols, 3) + self.everywhere(mean)
        return features, torch.cat([mean.flatten(1), coarse.amax(dim=(2, 3))], dim=1)


class CompactNet(nn.Module):
    """The network described at the head of this file.

    Args:
        config: shape of the network.
    """

    ARCHITECTURES: tuple[str, ...] = (
        "foresee-compact-1",
        "foresee-compact-2",
        "foresee-compact-4",
    )
    """Names in files of weights: without a context, with one, and also with kinds of building. The
    number changes when the meaning of weights does: 3 had another formula of the doubt."""
    CONFIG = CompactConfig

    def __init__(self, config: CompactConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or CompactConfig()
        widths, cells = config.widths, config.patch**2
        self.stem = Conv(2 * cells, widths[0])
        self.encode = nn.ModuleList(
            nn.Sequential(*(Block(width) for _ in range(count)))
            for width, count in zip(widths, config.blocks, strict=True)
        )
        pairs = list(pairwise(widths))
        self.down = nn.ModuleList(nn.Conv2d(fine, coarse, 2, 2) for fine, coarse in pairs)
        self.up = nn.ModuleList(nn.ConvTranspose2d(coarse, fine, 2, 2) for fine, coarse in pairs)
        self.decode = nn.ModuleList(Block(width) for width in widths[:-1])
        self.head = nn.Conv2d(widths[0], config.outputs * cells, 1)
        self.context = ContextNet(config.context, widths[STAGE]) if config.context else None
        self.kinds: nn.Linear | None = None
        if config.kinds:
            self.kinds = nn.Linear(4 * config.context, len(config.kinds))
            # Part of the weights, since calibrations hold for these values alone.
            self.doubts: Tensor
            self.register_buffer("doubts", torch.ones(len(config.kinds)))
        # The lowest and highest input of each of its `convolutions`.
        self.ranges: Tensor | None
        count = len(self.convolutions())
        self.register_buffer("ranges", torch.zeros(count, 2) if config.quantised else None)

    def convolutions(self) -> list[tuple[nn.Module, str]]:
        """Return the convolutions outside of the context, as `quantised_conv.convolutions` does."""
        of_context = {id(parent) for parent, _ in convolutions(self.context or nn.Module())}
        return [place for place in convolutions(self) if id(place[0]) not in of_context]

    @property
    def architecture(self) -> str:
        """Name in files of weights."""
        return self.ARCHITECTURES[(self.context is not None) + (self.kinds is not None)]

    def forward(self, known: Tensor, context: Tensor | None = None) -> Tensor:
        """Return logits (B, 4, H, W) of FREE, OCCUPIED and HIDDEN (softmax), and ROOM (sigmoid).

        See `all_logits` for the arguments.
        """
        return self.all_logits(known, context)[0]

    def doubt(self, kinds: Tensor) -> Tensor:
        """Return the doubt, (B,), for the logits of the kinds of building, (B, kinds).

        The doubt of a kind is the factor by which predictions are wrong more often there than in
        other kinds. The result is the larger of two values: the mean of these doubts over the
        probabilities of the kinds, and the largest of them, each scaled as described at `LIKELY`.
        The mean is high while no kind is likely, the other where one is. Doubts in the weights are
        limited to [1, `MOST_DOUBT`].
        """
        chances = torch.softmax(kinds, dim=1)
        doubts = self.doubts.clamp(1.0, MOST_DOUBT)
        largest = ((chances / LIKELY).clamp(max=1.0) * doubts.log()).amax(dim=1).exp()
        # The largest is at least 1 exactly, which the mean is not after rounding.
        return torch.maximum(largest, chances @ doubts)

    def all_logits(
        self, known: Tensor, context: Tensor | None = None
    ) -> tuple[Tensor, Tensor | None]:
        """Return the logits of `forward`, and those of `config.kinds`, (B, kinds), if any.

        Args:
            known: 1 where observed free, and 1 where observed occupied, (B, 2, H, W); H and W are
                multiples of `config.multiple`.
            context: shares in [0, 1] observed free, and observed occupied, (B, 2, CELLS, CELLS),
                see `foresee.mapping.context`; needed if the network has a context.
        """
        x = F.relu(self.stem(F.pixel_unshuffle(known, self.config.patch)))
        skips, kinds = [], None
        for number, (stage, down) in enumerate(zip(self.encode, self.down, strict=False)):
            if number == STAGE and self.context is not None:
                features, summary = self.context(context, x.shape[2], x.shape[3])
                x = x + features
                kinds = None if self.kinds is None else self.kinds(summary)
            x = stage(x)
            skips.append(x)
            x = F.relu(down(x))
        x = self.encode[-1](x)
        for up, decode in reversed(list(zip(self.up, self.decode, strict=True))):
            x = decode(up(x) + skips.pop())
        return F.pixel_shuffle(self.head(x), self.config.patch), kinds

    def with_context(self, width: int) -> CompactNet:
        """Return this network, or a copy with a context that does not change the output yet.

        Args:
            width: channels of the finest stage of the context's network. If it is 0, or this
                network has a context already, this network is returned.
        """
        if self.context is not None or not width:
            return self
        other = CompactNet(replace(self.config, context=width))
        other.load_state_dict(other.state_dict() | self.state_dict())
        return other

    def with_kinds(self, kinds: tuple[str, ...]) -> CompactNet:
        """Return a copy with a layer for kinds of building, which is not trained yet.

        Args:
            kinds: their names.

        Raises:
            ValueError: if this network has no context.
        """
        if self.context is None:
            raise ValueError("without a context, a network cannot classify the building")
        other = CompactNet(replace(self.config, kinds=kinds))
        kept = {
            n: v for n, v in self.state_dict().items() if n.split(".")[0] not in ("kinds", "doubts")
        }
        other.load_state_dict(other.state_dict() | kept)
        return other

    def with_ranges(self, ranges: Tensor | None) -> CompactNet:
        """Return a copy that computes in 8-bit integers, once it is `folded`.

        Args:
            ranges: lowest and highest input of each of its `convolutions`, (n, 2); None: it
                computes in floating-point numbers.
        """
        other = CompactNet(replace(self.config, quantised=ranges is not None))
        kept = {name: v for name, v in self.state_dict().items() if name != "ranges"}
        other.load_state_dict(kept if ranges is None else kept | {"ranges": ranges})
        return other.eval()

    def without_kinds_and_ranges(self) -> CompactNet:
        """Return this network, or a copy without the layer for kinds of building and the ranges."""
        if self.kinds is None and self.ranges is None:
            return self
        other = CompactNet(replace(self.config, kinds=(), quantised=False))
        other.load_state_dict({name: self.state_dict()[name] for name in other.state_dict()})
        return other

    def folded(self) -> CompactNet:
        """Merge batch normalisation, and quantise, in place, for inference; return this network."""
        self.eval()
        places = self.convolutions()
        for module in self.modules():
            if isinstance(module, Conv):
                module.fold()
        if self.ranges is not None:
            quantise(places, self.ranges)
            self.ranges = None
        return self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def room_masks(seen: Tensor) -> tuple[Tensor, Tensor]:
    """Find the cells without room, and those whose room is not known yet.

    Args:
        seen: codes 0 free, 1 occupied, 2 unobserved, (B, H, W).

    Returns:
        Two masks (B, H, W): cells whose square contains a cell observed occupied, and cells whose
        square contains none, but an unobserved cell. The squares of all others were observed free.
    """
    barred = widened((seen == 1).byte()) > 0
    return barred, (widened((seen == 2).byte()) > 0) & ~barred


def widened(values: Tensor, reach: int = ROOM_REACH) -> Tensor:
    """Return the largest value in the square around each cell, (B, H, W).

    Args:
        values: value of each cell, at least 0, (B, H, W).
        reach: half the width of the square, without the middle cell [cells].
    """
    # Doubling the width, one axis after the other, is 20 times as fast as max_pool2d.
    out = F.pad(values, (reach, reach, reach, reach))
    for axis in (1, 2):
        width = 1
        while width < 2 * reach + 1:
            step = min(width, 2 * reach + 1 - width)
            length = out.shape[axis] - step
            out = torch.maximum(out.narrow(axis, 0, length), out.narrow(axis, step, length))
            width += step
    return out


def _around(features: Tensor, count: int, axis: int) -> Tensor:
    """Return the cells that decide the `count` middle cells of half the size after a `Block`.

    These are the middle cells and 2 more on each side, as far as there are any.
    """
    size = features.shape[axis]
    spare = size // 2 - ((count + 2) // 4 + 2)
    start = (spare + abs(spare)) // 2  # max(spare, 0), in a form that is traced
    index = torch.arange(size - 2 * start, device=features.device) + start
    return features.index_select(axis, index)


def _middle(features: Tensor, count: int, axis: int) -> Tensor:
    """Return the cells in the middle of an axis, the outermost repeated if there are too few."""
    size = features.shape[axis]
    index = torch.arange(count, device=features.device) + (size - count) // 2
    return features.index_select(axis, index.clamp(0, size - 1))
