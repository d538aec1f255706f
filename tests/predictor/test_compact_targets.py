"""What the compact network learns from: the weights of cells, and the kind of building."""

import numpy as np
import pytest
import torch

from foresee.mapping.context import CELLS
from predictor.data.samples import Samples
from predictor.data.squares import NOTHING, joined
from predictor.networks.compact_net import ContextNet
from predictor.training.compact_targets import losses, nearness
from predictor.training.compact_training import KindOfBuilding


def codes_with(seen_cell, side=64):
    """Codes of free space, of which one cell was observed."""
    seen = np.full((side, side), NOTHING, np.uint8)
    seen[seen_cell] = 0
    return torch.from_numpy(joined(seen, np.zeros_like(seen)))[None]


@pytest.mark.parametrize(
    ("distance", "weight"),
    [(0, 4.5), (5, 4.5), (6, 2.5), (10, 2.5), (11, 1.5), (20, 1.5), (21, 1.0), (31, 1.0)],
)
def test_cells_near_what_was_observed_weigh_more(distance, weight):
    seen = torch.full((1, 64, 64), NOTHING, dtype=torch.uint8)
    seen[0, 32, 32] = 1
    assert nearness(seen)[0, 32, 32 - distance] == weight
    assert nearness(seen)[0, 32 - distance, 32] == weight


def test_the_loss_of_cells_is_a_weighted_mean():
    codes, logits = codes_with((32, 32)), torch.zeros(1, 4, 64, 64)
    assert losses(logits, codes)[0] == pytest.approx(np.log(3.0))
    wrong_near, wrong_far = logits.clone(), logits.clone()
    wrong_near[0, 0, 32, 34], wrong_far[0, 0, 32, 60] = -5.0, -5.0
    near, far = (float(losses(wrong, codes)[0]) - np.log(3.0) for wrong in (wrong_near, wrong_far))
    assert near == pytest.approx(4.5 * far, rel=1e-3)


def test_the_context_learns_which_family_it_sees():
    torch.manual_seed(0)
    net = ContextNet(4, 8).train()
    kinds = KindOfBuilding(net, 2)
    learned = torch.optim.Adam([*net.parameters(), *kinds.parameters()], 1e-2)
    families = torch.tensor([0, 1] * 4)
    contexts = families[:, None, None, None] * torch.ones(8, 2, CELLS, CELLS)
    codes = codes_with((5, 5)).repeat(8, 1, 1)
    found = []
    for _ in range(40):
        net(contexts + 0.1 * torch.rand_like(contexts), 10, 10)
        loss = kinds.loss(families, codes)
        learned.zero_grad()
        loss.backward()
        learned.step()
        found.append(float(loss.detach()))
    # Of two equal families, log 2; and all cells are free.
    assert found[-1] < 0.2 < np.log(2.0) < found[0]


def test_families_of_samples_are_numbered_and_maps_of_ones_own_are_one():
    about = [{"family": "office"}, {"family": "map"}, {"family": "corridor"}, {"family": "map"}]
    starts = np.array([[0, 0, 1], [1, 0, 1], [2, 0, 1], [3, 0, 1], [3, 1, 2]])
    samples = Samples([np.zeros(2, np.uint8)] * 4, starts, about, {})
    assert len(samples.families) == 3
    assert samples.family_numbers.tolist() == [2, 1, 0, 1, 1]
