"""The networks: what goes in and comes out, what they start as, and which weights they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from priors.learned import shipped_initializer
from priors.networks.blocks import from_opponent, opponent, padded
from priors.networks.checkpoint import load_network, save_network
from priors.networks.critics import CompactEncoder, Vgg19Encoder, WrongWeights, vgg19_weights
from priors.networks.fusionnet import Architecture, Form, SeparationNetwork
from priors.networks.polarnet import PolarNet
from priors.networks.unmixing import along_main_axis
from priors.observation import collated, in_color, of_arrays
from tests.observations import SMALL, observation, small_network

FORMS: tuple[Form, ...] = get_args(Form)


def test_without_the_head_the_papers_form_tries_no_panes(tmp_path: Path) -> None:
    network = trained_a_little(small_network("paper", head="none")).half().float()
    seen = observation("paper", (19, 23))
    found = network(seen)
    assert found.layers.shape == (1, 2, 3, 19, 23)
    assert found.parts.shape == (1, 4, 2, 3, 19, 23)
    assert not any("unmixing" in name for name in network.state_dict())
    assert torch.equal(found.layers, network(replace(seen, shares=None)).layers)
    # Not so with it.
    with pytest.raises(ValueError, match="candidate panes"):
        small_network("paper")(replace(seen, shares=None))
    digest = save_network(tmp_path / "net.safetensors", network)
    again = load_network(tmp_path / "net.safetensors", digest)
    assert again.architecture == network.architecture
    assert again.architecture.head == "none"
    assert torch.equal(again(seen).layers, found.layers)


def test_before_any_training_the_layers_without_the_head_are_the_intensity() -> None:
    seen = observation("paper")
    layers = small_network("paper", head="none")(seen).layers
    torch.testing.assert_close(layers, (seen.views.sum(1) / 2)[:, None].expand_as(layers))


def test_only_the_papers_form_has_a_head_to_do_without() -> None:
    with pytest.raises(ValueError, match="paper's form"):
        Architecture("conditioned", head="none")


def test_shipped_weights_are_of_the_form_with_the_head() -> None:
    assert shipped_initializer("paper").network.architecture.head == "panes"


@settings(max_examples=8, deadline=None)
@given(st.sampled_from(FORMS), st.integers(17, 45), st.integers(17, 45))
def test_images_of_any_size_come_back_in_their_size(form: Form, height: int, width: int) -> None:
    found = small_network(form)(observation(form, (height, width)))
    assert found.layers.shape == (1, 2, 3, height, width)
    assert found.parts.shape == (1, 4 if form == "paper" else 2, 2, 3, height, width)


def test_before_any_training_the_conditioned_form_is_the_closed_form() -> None:
    seen = observation("conditioned")
    torch.testing.assert_close(small_network()(seen).layers, seen.layers)


def test_before_any_training_the_parts_add_up_to_the_photograph() -> None:
    photographs = torch.rand(2, 3, 20, 28)
    parts = PolarNet(CompactEncoder((4, 6)))(photographs)
    torch.testing.assert_close(parts.sum(1), photographs)


def test_a_batch_gives_what_its_captures_give_alone() -> None:
    network = trained_a_little(small_network())
    several = [observation(seed=seed) for seed in (1, 2, 3)]
    together = network(collated(several)).layers
    alone = torch.cat([network(seen).layers for seen in several])
    torch.testing.assert_close(together, alone, atol=1e-5, rtol=1e-4)


def trained_a_little(network: SeparationNetwork) -> SeparationNetwork:
    """With weights that are nowhere zero."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter += 0.02 * torch.randn_like(parameter)
    return network


def test_the_opponent_basis_is_orthonormal_with_luminance_first() -> None:
    images = torch.rand(2, 3, 5, 7)
    torch.testing.assert_close(from_opponent(opponent(images)), images)
    torch.testing.assert_close(opponent(images).square().sum(1), images.square().sum(1))
    assert opponent(in_color(torch.rand(1, 1, 4, 4)))[:, 1:].abs().max() < 1e-6


def test_padding_continues_the_edges_and_leaves_whole_multiples_alone() -> None:
    images = torch.rand(2, 3, 5, 9)
    larger = padded(images, 8)
    assert larger.shape == (2, 3, 8, 16)
    torch.testing.assert_close(larger[..., :5, :9], images)
    torch.testing.assert_close(larger[..., 5:, :9], images[..., 4:, :].expand(-1, -1, 3, -1))
    assert padded(larger, 8) is larger


def test_an_observation_takes_grey_and_color() -> None:
    arrays = {"views": torch.rand(4, 1, 6, 7), "view_errors": torch.ones(4), "trusted": torch.ones(1, 1, 6, 7)}
    seen = of_arrays(**{name: array.numpy() for name, array in arrays.items()})
    assert seen.views.shape == (1, 4, 3, 6, 7)
    with pytest.raises(ValueError, match="1 or 3"):
        in_color(torch.rand(2, 6, 7))


def test_the_plain_network_of_the_ablation_has_neither_encoder_nor_levels() -> None:
    network = SeparationNetwork(Architecture("paper", "plain", **SMALL))
    assert network(observation("paper", (19, 23))).parts.shape == (1, 4, 2, 3, 19, 23)
    assert not any("encoder" in name for name in network.state_dict())


def test_weights_come_back_from_their_file(tmp_path: Path) -> None:
    """To the half precision that they are kept in."""
    network = trained_a_little(small_network()).half().float()
    digest = save_network(tmp_path / "net.safetensors", network)
    again = load_network(tmp_path / "net.safetensors", digest)
    seen = observation()
    assert again.architecture == network.architecture
    assert torch.equal(again(seen).layers, network.eval()(seen).layers)


def test_weights_that_are_not_numbers_are_refused(tmp_path: Path) -> None:
    network = small_network()
    with torch.no_grad():
        next(network.parameters())[0] = float("nan")
    save_network(tmp_path / "net.safetensors", network)
    with pytest.raises(WrongWeights, match="NaN"):
        load_network(tmp_path / "net.safetensors")


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    from safetensors.torch import save_file

    path = tmp_path / "net.safetensors"
    with pytest.raises(WrongWeights, match="no such file"):
        load_network(path)
    save_network(path, small_network())
    with pytest.raises(WrongWeights, match="digest"):
        load_network(path, "0" * 64)
    save_file({"weight": torch.ones(2)}, path)
    with pytest.raises(WrongWeights, match="holds no network"):
        load_network(path)
    path.write_bytes(b"not a file of weights")
    with pytest.raises(WrongWeights, match="holds no network"):
        load_network(path)


def vgg_state() -> dict[str, torch.Tensor]:
    """Numbers in torchvision's layout, too small in value to matter."""
    sizes = [(3, 64), (64, 64), (64, 128), (128, 128), (128, 256), *[(256, 256)] * 3, (256, 512), *[(512, 512)] * 7]
    numbers = (0, 2, 5, 7, 10, 12, 14, 16, 19, 21, 23, 25, 28, 30, 32, 34)
    state = {}
    for number, (n_in, n_out) in zip(numbers, sizes, strict=True):
        state[f"features.{number}.weight"] = torch.full((n_out, n_in, 3, 3), 1e-3)
        state[f"features.{number}.bias"] = torch.zeros(n_out)
    return state


def test_vgg19_is_read_from_a_file_only_if_all_is_as_it_should_be(tmp_path: Path) -> None:
    path = tmp_path / "vgg19.pth"
    with pytest.raises(WrongWeights, match="take the encoder compact"):
        SeparationNetwork(Architecture("paper", "vgg19"), path)
    state = vgg_state()
    torch.save(state, path)
    with pytest.raises(WrongWeights, match="digest"):
        vgg19_weights(path)
    encoder = Vgg19Encoder(vgg19_weights(path, digest=None))
    assert [tuple(level.shape[1:]) for level in encoder(torch.rand(1, 3, 32, 16))] == [
        (64, 32, 16), (128, 16, 8), (256, 8, 4), (512, 4, 2), (512, 2, 1)
    ]  # fmt: skip
    assert not any(parameter.requires_grad for parameter in encoder.parameters())
    assert PolarNet(encoder)(torch.rand(1, 3, 20, 20)).shape == (1, 2, 3, 20, 20)
    del state["features.34.weight"]
    torch.save(state, path)
    with pytest.raises(WrongWeights, match=r"features\.34\.weight"):
        vgg19_weights(path, digest=None)


def test_photographs_turned_with_the_camera_show_the_same_along_their_main_axis() -> None:
    views = observation("paper", seed=3).views
    total, s1, s2 = views.sum(1) / 2, views[:, 0] - views[:, 2], views[:, 1] - views[:, 3]
    turn = math.radians(2 * 25)
    t1, t2 = math.cos(turn) * s1 - math.sin(turn) * s2, math.sin(turn) * s1 + math.cos(turn) * s2
    turned = torch.stack([total + t1, total + t2, total - t1, total - t2], dim=1) / 2
    noise = torch.full((1, 4), 0.005)
    shown, again = along_main_axis(views, noise), along_main_axis(turned, noise)
    assert torch.allclose(shown.images, again.images, atol=1e-5)
    assert torch.allclose(shown.numbers[:, :-2], again.numbers[:, :-2], atol=1e-3)
