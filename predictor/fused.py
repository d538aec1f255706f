"""Predictors of several expansions in one: the nearest says what is near, the farthest the rest.

Katyal et al. 2018 leave it to future work to combine predictions "with the stable results generated
by the shorter horizon predictions". Of each cell speaks the network of the smallest square that
holds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from predictor.image_predictor import ImagePredictor, believed
from predictor.mapping.grid import Grid
from predictor.prediction import Prediction
from predictor.weights import WeightsError


class Fused:
    """A predictor made of networks of one architecture, each trained for another expansion.

    Args:
        weights: .safetensors file of each network, written by `predictor.train`.

    Raises:
        WeightsError: if there are fewer than two, two of one expansion, or one that is not given
            what the others are.
    """

    def __init__(self, weights: Sequence[Path]) -> None:
        made = sorted(
            ((ImagePredictor(path), path) for path in weights),
            key=lambda one: one[0].config.expansion,
        )
        self.parts = [part for part, _ in made]
        self.weights = [path for _, path in made]
        if len({part.config.expansion for part in self.parts}) < max(2, len(made)):
            raise WeightsError(
                "fused networks must be two at least, each for another expansion; these are "
                + (", ".join(map(str, weights)) or "none")
            )
        if len({part.config.given for part in self.parts}) > 1:
            raise WeightsError("fused networks must all be given the same, the crop or the window")

    @classmethod
    def of_study(cls, spec: str) -> Fused:
        """Return the networks of an architecture that a study has trained, as one predictor.

        Args:
            spec: FOLDER/ARCH.

        Raises:
            WeightsError: if there are no two such networks.
        """
        folder, arch = Path(spec).parent, Path(spec).name
        return cls(sorted(folder.glob(f"{arch}-*/{arch}.safetensors")))

    @property
    def given(self) -> str:
        """What the networks are given: one of `predictor.networks.image_config.GIVEN`."""
        return self.parts[0].config.given

    @property
    def facts(self) -> dict[str, Any]:
        """Fingerprints, runtime and buildings of all networks together."""
        every = [part.facts for part in self.parts]
        worlds = {
            name: [world for facts in every for world in facts.get(name, ())]
            for name in ("worlds", "validation_worlds")
        }
        prints = "+".join(facts["fingerprint"] for facts in every)
        return {"fingerprint": prints, "runtime": every[0]["runtime"], **worlds}

    def predict(self, known: Grid, pose: NDArray[np.float64]) -> Prediction:
        """Predict the unobserved part of a window.

        Raises:
            ValueError: if the window is empty or the pose not finite.
        """
        return believed(known, self.printed(known, pose))

    def printed(self, known: Grid, pose: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the layers of `ImagePredictor.printed`, each cell from the smallest square.

        Raises:
            ValueError: if the window is empty or the pose not finite.
        """
        out = np.zeros((4, *known.frame.shape), dtype=np.float32)
        for part in self.parts:
            out = np.where(out[3] > 0, out, part.printed(known, pose))
            if out[3].all():
                break
        return out
