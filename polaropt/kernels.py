"""Which kernels a separation needs, for compiling them before."""

from __future__ import annotations

from solvers.ahead import begin_ahead, compile_ahead

# Those that take longest to compile first.
KERNELS = (
    "polaropt.solving.kernels.penalties",
    "polaropt.solving.kernels.misfit",
    "polaropt.inversion.compiled_whitening",
    "polaropt.estimation.flat.windows.kernels",
    "solvers.passes",
    "polaropt.solving.kernels.windows",
    "polaropt.estimation.flat.windows.tile_kernels",
    "polaropt.judging.kernels",
)
"""Modules with the kernels that a plain separation needs."""
KERNELS_OF_MOSAICS = ("polaropt.numerics.alias_kernels",)
"""Those that a raw mosaic needs beside them, once it is read."""
KERNELS_OF_POLARIZED_LIGHT = (
    "polaropt.estimation.polarized.tile_kernels",
    "polaropt.estimation.polarized.kernels",
)
"""Those that a scene in polarized light needs beside them."""


def compile_kernels(*, wait: bool = True) -> None:
    """Compile what photographs and mosaics need, in polarized light, too, and is not kept on disk, on all cores.

    Parameters
    ----------
    wait : bool
        False goes on at once, while other cores compile what everyone needs.
    """
    if wait:
        compile_ahead((*KERNELS, *KERNELS_OF_MOSAICS, *KERNELS_OF_POLARIZED_LIGHT))
    else:
        begin_ahead((*KERNELS, *KERNELS_OF_MOSAICS))
