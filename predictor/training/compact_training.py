"""The training of the compact network: samples in, averaged weights out.

A checkpoint holds everything that decides what comes next, and what a step does depends on its
number and the seed alone: a training that was killed and started again by the same command ends
as if it had not been, on a CPU to the last bit.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from predictor.infra.atomic_file import clear, write_whole
from predictor.infra.environment import commit
from predictor.networks.compact_net import CompactNet
from predictor.training.checkpoint import TrainError, read_checkpoint, write_checkpoint
from predictor.training.curve import draw_curve
from predictor.training.targets import batch_of, known_of, losses
from predictor.training.validation import validate
from predictor.weights import save_weights

if TYPE_CHECKING:
    from torch import Tensor

    from predictor.data.samples import Samples


@dataclass(frozen=True)
class TrainConfig:
    """What decides the numbers of a training.

    Attributes:
        steps: of the optimiser.
        batch: samples a step, of the usual side; fewer of a larger one, more of a smaller.
        rate: highest learning rate.
        warmup: steps in which it rises; then it falls along a cosine to nothing.
        decay: of weights, by AdamW.
        average: of weights from step to step: how much of the old average stays.
        seed: of the first weights and of the order of samples.
        start: fingerprint of the weights that it starts from; None: random ones.
    """

    steps: int = 8_000
    batch: int = 32
    rate: float = 2e-3
    warmup: int = 300
    decay: float = 0.02
    average: float = 0.998
    seed: int = 0
    start: str | None = None


SIDES = (200, 200, 200, 120, 160, 240, 280)
"""Sides of what a step learns from [cells], drawn from: windows and expansions differ."""
USUAL = 200
"""The side at a window of 5 m, twice expanded."""
CURVES = (("loss", "nll"), ("iou_free", "iou_occupied", "auc_free"), ("ece_free", "brier_free"))
"""What of the log is drawn, by panel."""


class Trainer:
    """A training that can be left and taken up again.

    Args:
        config: what decides its numbers.
        train: samples to learn from.
        validation: samples to measure on.
        out: folder of checkpoint, log and weights.
        start: weights to start from, and the facts of their training; None: random ones.

    Raises:
        TrainError: if the folder holds another training, or the weights to start from have learned
            from buildings to validate on.
    """

    def __init__(
        self,
        config: TrainConfig,
        train: Samples,
        validation: Samples,
        out: Path,
        start: tuple[CompactNet, dict[str, Any]] | None = None,
    ) -> None:
        import torch

        self.config, self.train, self.validation, self.out = config, train, validation, out
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.brief = self.device.type == "cuda" or bool(
            torch.cpu.get_capabilities().get("avx512_bf16")
        )
        # Where one sum in another order would make another network.
        torch.backends.cudnn.deterministic = True
        torch.manual_seed(config.seed)
        net, before = (CompactNet(), {}) if start is None else start
        both = validation.worlds & set(before.get("worlds", ()))
        if both:
            raise TrainError(f"--start: its weights have learned from {len(both)} of the buildings "
                             "to validate on")  # fmt: skip
        self.net = net.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.averaged = {name: v.detach().clone() for name, v in self.net.state_dict().items()}
        self.optimizer = torch.optim.AdamW(self.net.parameters(), config.rate, (0.9, 0.98),
                                           weight_decay=config.decay)  # fmt: skip
        self.step = 0
        self.log: list[dict[str, float]] = []
        self.losses: list[float] = []
        """Of the steps since the last validation."""
        self.commits: set[str] = set()
        """Of the code that made its steps."""
        out.mkdir(parents=True, exist_ok=True)
        clear(out)
        self._facts = {
            "config": dataclasses.asdict(config),
            "network": json.loads(json.dumps(dataclasses.asdict(self.net.config))),
            # What else decides the last bits of the sums.
            "device": self.device.type,
            "threads (--jobs)": torch.get_num_threads(),
            "bfloat16": self.brief,
            "data": [train.digest, validation.digest],
            "before": {
                name: before[name]
                for name in ("fingerprint", "config", "drives", "samples", "commit", "before")
                if name in before
            },
            "drives": len(train.about),
            "samples": len(train),
            "worlds": sorted(train.worlds | set(before.get("worlds", ()))),
            "validation_worlds": sorted(
                validation.worlds | set(before.get("validation_worlds", ()))
            ),
        }
        self._resume()

    @property
    def checkpoint(self) -> Path:
        """Where the state is kept."""
        return self.out / "checkpoint.pt"

    def run(self, validate_every: int, save_every: float) -> Path:
        """Train to the end, with a progress bar, and export the weights.

        Args:
            validate_every: steps.
            save_every: seconds between checkpoints; one follows each validation too.
        """
        from tqdm import tqdm

        steps, code = self.config.steps, commit() or "no checkout"
        saved = time.monotonic()
        with (
            tqdm(total=steps, initial=self.step, unit="step", smoothing=0.05) as bar,
            ThreadPoolExecutor(1) as ahead,
        ):
            for codes in self._batches(ahead):
                self.losses.append(self._learn(codes))
                self.step += 1
                self.commits.add(code)
                bar.update()
                validated = self.step % validate_every == 0 or self.step == steps
                if validated:
                    self._note()
                    last = self.log[-1]
                    bar.set_postfix_str(
                        f"loss {last['loss']:.3f}, validation: NLL {last['nll']:.3f}, "
                        f"IoU free {last['iou_free']:.3f}, ECE {last['ece_free']:.3f}"
                    )
                if validated or time.monotonic() - saved > save_every:
                    self.save()
                    saved = time.monotonic()
        return self.export()

    def save(self) -> None:
        """Write the checkpoint, whole or not at all."""
        state = {
            "facts": self._facts, "step": self.step, "log": self.log, "losses": self.losses,
            "commits": sorted(self.commits), "net": self.net.state_dict(),
            "averaged": self.averaged,
            "optimizer": self.optimizer.state_dict(),
        }  # fmt: skip
        write_checkpoint(self.checkpoint, state)

    def export(self) -> Path:
        """Write the averaged weights, the log, and the curve."""
        commits = " ".join(sorted(self.commits))
        facts = self._facts | {"commit": commits, "validation": self.log[-1]}
        path = self.out / "compact.safetensors"
        save_weights(path, self.smoothed(), facts)
        draw_curve(self.log, self.out / "curve.png", CURVES)
        return path

    def smoothed(self) -> CompactNet:
        """The network of averaged weights, which is what is measured and shipped."""
        import torch

        net = CompactNet(self.net.config).to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        net.load_state_dict(self.averaged)
        return net.eval()

    def _resume(self) -> None:
        state = read_checkpoint(self.checkpoint, self._facts, self.device)
        if state is not None:
            self.net.load_state_dict(state["net"])
            self.averaged = state["averaged"]
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.log, self.losses = state["step"], state["log"], state["losses"]
            self.commits = set(state["commits"])

    def _batches(self, ahead: ThreadPoolExecutor) -> Iterator[Tensor]:
        """The codes of each step still to be made, one made ready while another is learnt from."""
        coming = ahead.submit(self._batch, self.step)
        for step in range(self.step, self.config.steps):
            codes = coming.result()
            coming = ahead.submit(self._batch, step + 1)
            yield codes

    def _batch(self, step: int) -> Tensor:
        import numpy as np

        rng = np.random.default_rng([self.config.seed, step])
        side = int(rng.choice(SIDES))
        count = max(1, round(self.config.batch * (USUAL / side) ** 2))
        chosen = rng.integers(len(self.train), size=count)
        return batch_of([self.train[int(i)] for i in chosen], side, rng.random(count) < 0.5)

    def _learn(self, codes: Tensor) -> float:
        """One step of the optimiser; the loss before it."""
        import torch

        config, step = self.config, self.step
        share = min(1.0, (step + 1) / config.warmup)
        fall = 0.5 * (1.0 + math.cos(math.pi * step / config.steps))
        for group in self.optimizer.param_groups:
            group["lr"] = config.rate * share * fall
        self.net.train()
        codes = codes.to(self.device)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.brief):
            logits = self.net(known_of(codes))
        loss = sum(losses(logits.float(), codes), torch.zeros((), device=self.device))
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        # Early on, the average follows fast: it must forget the first weights.
        keep = min(config.average, step / (step + 10.0))
        with torch.no_grad():
            for name, values in self.net.state_dict().items():
                if values.dtype.is_floating_point:
                    self.averaged[name].lerp_(values, 1.0 - keep)
                else:
                    self.averaged[name].copy_(values)
        return float(loss.detach())

    def _note(self) -> None:
        """Validate, and write it down."""
        entry = {"step": self.step, "loss": sum(self.losses) / len(self.losses)}
        self.losses = []
        self.log.append(entry | validate(self.smoothed(), self.validation, USUAL).measures())
        lines = "".join(json.dumps(line) + "\n" for line in self.log)
        write_whole(self.out / "log.jsonl", lines.encode())
