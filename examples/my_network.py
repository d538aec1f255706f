"""Train a network of your own in PyTorch, export it to ONNX, check it and drive with it.

pip install 'foresee-nav[openvino,onnx]'
python -m examples.my_network
foresee corridor --predictor examples.my_network:MyNetwork --out results/my_network
"""

import argparse
import logging
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.utils.data import DataLoader, Dataset

import foresee
from foresee.infra.atomic_file import replacing
from foresee.mapping.conventions import RESOLUTION
from foresee.mapping.resampling import resampled
from predictor import check
from predictor.data.samples import Samples, quarters
from predictor.data.squares import NOTHING, encode_cells, middle, parted
from predictor.recording.settings import DrivesConfig
from predictor.recording.training_drives import make

SIDE = 200
"""Side of the squares that the network learns from [cells of 0.05 m]."""
MULTIPLE = 8
"""The sides of the network's input are multiples of this [cells]."""


class Squares(Dataset):
    """Observed and true maps of the squares around the car, which looks along +x."""

    def __init__(self, folder, drives=None):
        self.samples = Samples.load(folder, drives)

    def __len__(self):
        return len(self.samples)

    def __getitem__(self, index):
        """Return codes (SIDE, SIDE): 0 free, 1 occupied, 2 unobserved, in the truth hidden."""
        seen, truth = parted(middle(self.samples[index], SIDE).astype(np.int64))
        return seen, truth


class Net(nn.Module):
    """From the observed map to the probabilities of free, occupied and hidden.

    It looks at patches of 4 × 4 cells, with dilated convolutions at half that resolution between.
    """

    def __init__(self, width=32):
        super().__init__()

        def layer(n_in, n_out, dilation=1, stride=1):
            conv = nn.Conv2d(n_in, n_out, 3, stride, dilation, dilation, bias=False)
            return nn.Sequential(conv, nn.BatchNorm2d(n_out), nn.ReLU())

        self.near = nn.Sequential(nn.PixelUnshuffle(4), layer(32, width), layer(width, width))
        self.wide = nn.Sequential(
            layer(width, 2 * width, stride=2),
            *(layer(2 * width, 2 * width, dilation) for dilation in (1, 2, 4, 8)),
            nn.Conv2d(2 * width, 4 * width, 1),
            nn.PixelShuffle(2),
        )
        self.last = nn.Sequential(
            layer(2 * width, width), nn.Conv2d(width, 3 * 16, 1), nn.PixelShuffle(4)
        )

    def forward(self, known):
        """Return the logits (B, 3, H, W) for what was observed free and occupied, (B, 2, H, W)."""
        near = self.near(known)
        return self.last(torch.cat([near, self.wide(near)], dim=1))


class Probabilities(nn.Module):
    """The network as it is exported."""

    def __init__(self, net):
        super().__init__()
        self.net = net

    def forward(self, known):
        """Return the probabilities (B, 3, H, W)."""
        return self.net(known).softmax(dim=1)


def loss_of(net, seen, truth):
    """Return the mean negative log-likelihood of the unobserved cells."""
    known = torch.stack([seen == 0, seen == 1], dim=1).float()
    each = nn.functional.cross_entropy(net(known), truth, reduction="none")
    unseen = seen == NOTHING
    return (each * unseen).sum() / unseen.sum()


def trained(folder, drives, steps, batch):
    """Train on the samples of a folder, and print the loss on those held out."""
    net, step = Net(), 0
    optimiser = torch.optim.AdamW(net.parameters(), 3e-3, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 3e-3, total_steps=steps)
    held_out = DataLoader(Squares(folder / "validation", drives[1]), batch)
    data = Squares(folder / "train", drives[0])
    loader = DataLoader(data, min(batch, len(data)), shuffle=True, drop_last=True)
    while step < steps:
        for seen, truth in loader:
            if torch.rand(()) < 0.5:  # Left and right are alike.
                seen, truth = seen.flip(1), truth.flip(1)
            loss = loss_of(net.train(), seen, truth)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            step += 1
            if step % 100 == 0 or step == steps:
                print(f"step {step}: loss {loss.item():.3f}", flush=True)
            if step == steps:
                break
    with torch.inference_mode():
        losses = [loss_of(net.eval(), *pair).item() for pair in held_out]
    print(f"held-out buildings: loss {np.mean(losses):.3f}")
    return net


def export(net, path):
    """Write a network to a file in the ONNX format, which contains no code."""
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # else: torchvision is not installed
    size = {2: torch.export.Dim("h", min=2) * MULTIPLE, 3: torch.export.Dim("w", min=2) * MULTIPLE}
    with replacing(path) as file:
        torch.onnx.export(
            Probabilities(net).eval(),
            (torch.zeros(1, 2, SIDE, SIDE),),
            file,
            dynamic_shapes={"known": size},
            external_data=False,
            verbose=False,
        )


class MyNetwork:
    """The predictor: it turns the map so that the car looks along +x, and runs the network."""

    weights = Path("my_network.onnx")
    context_side = 0.0

    def __init__(self):
        if not self.weights.is_file():
            raise FileNotFoundError(f"no {self.weights} here: python -m examples.my_network")
        import openvino

        settings = {"INFERENCE_NUM_THREADS": 1, "INFERENCE_PRECISION_HINT": "f32"}
        model = openvino.Core().compile_model(self.weights, "CPU", settings)
        self.request = model.create_infer_request()

    def predict(self, view):
        """Return the probabilities of the network; the confidence is 0.9999."""
        known, turns = view.known, quarters(float(view.pose[2]))
        # The network was trained on maps of this resolution.
        fine, old_rows, old_cols = resampled(known, RESOLUTION)
        codes = np.rot90(encode_cells(fine.cells), turns)
        rows, cols = codes.shape
        padded = np.pad(codes, [(0, -n % MULTIPLE) for n in codes.shape], constant_values=NOTHING)
        observed = np.stack([padded == 0, padded == 1])[None].astype(np.float32)
        chances = self.request.infer({0: observed})[0][0, :, :rows, :cols]
        free, occupied, _ = np.rot90(chances, -turns, axes=(1, 2))[:, old_rows][:, :, old_cols]
        return foresee.Prediction(known.frame, free, occupied, np.full(free.shape, 0.9999))


def compare(predictor, seeds):
    """Print the times of drives with this predictor, with `compact`, and of `known`."""
    for seed in seeds:
        arms = ("known", "predicted")
        runs = {
            name: foresee.drive("corridor", seed, arms=arms, route="fixed", predictor=name)
            for name in ("compact", predictor)
        }
        for name, run in runs.items():
            known, predicted = run.episodes
            print(
                f"corridor {seed}, {name}: {predicted.outcome} in {predicted.time:.1f} s, "
                f"known in {known.time:.1f} s"
            )


def main(argv=None):
    """Record, train, export, check and drive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--train", type=int, default=60, help="drives to learn from")
    parser.add_argument("--validation", type=int, default=8, help="drives that are held out")
    parser.add_argument("--steps", type=int, default=600, help="steps of the training")
    parser.add_argument("--batch", type=int, default=8, help="squares in a step")
    parser.add_argument("--drives", type=int, default=2, help="drives to compare with compact")
    parser.add_argument("--jobs", type=int, default=2, help="processes that record")
    parser.add_argument("--data", type=Path, default=Path("data/my_network"), help="samples")
    options = parser.parse_args(argv)
    torch.manual_seed(0)
    samples = DrivesConfig(out=options.data, train=options.train, validation=options.validation)
    make(samples, options.jobs)
    drives = options.train, options.validation
    export(trained(options.data, drives, options.steps, options.batch), MyNetwork.weights)
    module = __spec__.name if __spec__ else Path(__file__).stem
    name = f"{module}:MyNetwork"
    status = check.main([name])
    compare(name, range(1000, 1000 + options.drives))
    return status


if __name__ == "__main__":
    raise SystemExit(main())
