"""The learned start: trained networks that turn what is seen of a capture into layers."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from priors.networks.checkpoint import load_network
from priors.networks.critics import WrongWeights
from priors.networks.fusionnet import Form, SeparationNetwork
from priors.observation import Observation

Images = NDArray[np.float32]

WEIGHTS = Path(__file__).parent / "weights"
"""Weights (FORM.safetensors), their record with the digest (FORM.json) and their model cards (FORM.md)."""


class LearnedInitializer:
    """Layers from a trained network.

    Parameters
    ----------
    network : SeparationNetwork
    """

    def __init__(self, network: SeparationNetwork) -> None:
        self.network = network.eval()

    @torch.inference_mode()
    def layers(self, seen: Observation, n_channels: int) -> Images:
        """Layers (2, n_channels, h, w) of one capture, always the same for the same observation.

        Parameters
        ----------
        seen : Observation
            A batch of one.
        n_channels : int
            1 for a grey capture, else 3.
        """
        found = self.network(seen).layers[0]
        return np.asarray(found.mean(1, keepdim=True) if n_channels == 1 else found, dtype=np.float32)


@lru_cache(maxsize=2)
def shipped_initializer(form: Form = "conditioned") -> LearnedInitializer:
    """The weights inside the package, read once.

    Raises
    ------
    WrongWeights
        A file is missing, or the weights are not those that the record tells of.
    """
    record = WEIGHTS / f"{form}.json"
    if not record.is_file():
        raise WrongWeights(f"{record}: no such file; install polaropt again")
    digest = json.loads(record.read_text(encoding="utf-8"))["sha256"]
    return LearnedInitializer(load_network(WEIGHTS / f"{form}.safetensors", digest))
