import numpy as np
import pytest

from polaropt.numerics import opponent_basis, principal_colors


def test_principal_colors_are_those_in_which_edges_do_not_vary_together():
    random = np.random.default_rng(0)
    mixing = np.array([[1.0, 0.9, 0.7], [0.3, 0.0, -0.3], [0.05, -0.1, 0.05]])
    image = np.einsum("cn,chw->nhw", mixing, random.standard_normal((3, 48, 48))).astype(np.float32)
    basis = principal_colors(image, 0.0)
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    edges = np.diff(np.tensordot(basis, image, axes=1), axis=2).reshape(3, -1)
    correlation = np.corrcoef(edges)
    assert np.abs(correlation - np.eye(3)).max() < 0.1
    assert basis[0] @ np.ones(3) / np.sqrt(3) > 0.95


@pytest.mark.parametrize("image", [np.zeros((3, 16, 16)), np.tile(np.arange(16.0), (3, 16, 1))])
def test_principal_colors_of_grey_are_the_opponent_ones(image):
    found = principal_colors(image.astype(np.float32), 2.0)
    np.testing.assert_allclose(np.abs(found @ opponent_basis(3).T), np.eye(3), atol=1e-6)
