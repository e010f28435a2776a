__all__ = [
    "ALWAYS_OPPONENT",
    "GAP_STRIP",
    "LEAST_ENERGY",
    "MAD_TO_SIGMA",
    "MUCH_VALUES",
    "NATURAL_POWER_LAW",
    "ROUNDED",
    "AliasGroups",
    "AnyMask",
    "Basis",
    "BitMask",
    "Box",
    "Members",
    "alias_steps",
    "arrays_apart",
    "bilinear_transfer",
    "block_mean",
    "block_shares",
    "blurred_power",
    "column_multiplicity",
    "count_true",
    "each_plane",
    "enlarged",
    "explained_groups",
    "fill_gaps",
    "filter_of_groups",
    "filtered",
    "frequencies",
    "gap_values",
    "give_back_freed",
    "grid_minimum",
    "grid_sums",
    "hann_autocorrelation",
    "hann_spectra",
    "hann_tile",
    "in_color",
    "jackknife_error",
    "kept_while_alive",
    "left_out",
    "local_minima",
    "local_minimum",
    "middle_part",
    "minimum_error",
    "mixed_spectra",
    "natural_frequencies",
    "opponent_basis",
    "principal_colors",
    "quantization_step",
    "quietest_combination",
    "robust_spread",
    "second_differences",
    "sharpened",
    "smoothly_filled",
    "spread_blocks",
    "squared_blur",
    "squared_frequencies",
    "strips",
    "tukey_window",
    "turn_between",
    "vertex",
    "whole_blocks",
    "wiener_spectra",
]

from .aliases import AliasGroups as AliasGroups
from .aliases import Members as Members
from .aliases import alias_steps as alias_steps
from .aliases import explained_groups as explained_groups
from .aliases import filter_of_groups as filter_of_groups
from .aliases import mixed_spectra as mixed_spectra
from .aliases import wiener_spectra as wiener_spectra
from .bit_mask import AnyMask as AnyMask
from .bit_mask import BitMask as BitMask
from .bit_mask import count_true as count_true
from .blocks import GAP_STRIP as GAP_STRIP
from .blocks import block_mean as block_mean
from .blocks import block_shares as block_shares
from .blocks import enlarged as enlarged
from .blocks import fill_gaps as fill_gaps
from .blocks import gap_values as gap_values
from .blocks import middle_part as middle_part
from .blocks import smoothly_filled as smoothly_filled
from .blocks import spread_blocks as spread_blocks
from .blocks import strips as strips
from .blocks import whole_blocks as whole_blocks
from .color import ALWAYS_OPPONENT as ALWAYS_OPPONENT
from .color import LEAST_ENERGY as LEAST_ENERGY
from .color import Basis as Basis
from .color import in_color as in_color
from .color import opponent_basis as opponent_basis
from .color import principal_colors as principal_colors
from .jackknife import grid_sums as grid_sums
from .jackknife import jackknife_error as jackknife_error
from .jackknife import left_out as left_out
from .jackknife import minimum_error as minimum_error
from .memory import MUCH_VALUES as MUCH_VALUES
from .memory import arrays_apart as arrays_apart
from .memory import give_back_freed as give_back_freed
from .memory import kept_while_alive as kept_while_alive
from .minima import Box as Box
from .minima import grid_minimum as grid_minimum
from .minima import local_minima as local_minima
from .minima import local_minimum as local_minimum
from .minima import vertex as vertex
from .periodic import turn_between as turn_between
from .robust import MAD_TO_SIGMA as MAD_TO_SIGMA
from .robust import ROUNDED as ROUNDED
from .robust import quantization_step as quantization_step
from .robust import quietest_combination as quietest_combination
from .robust import robust_spread as robust_spread
from .robust import second_differences as second_differences
from .spectrum import NATURAL_POWER_LAW as NATURAL_POWER_LAW
from .spectrum import bilinear_transfer as bilinear_transfer
from .spectrum import blurred_power as blurred_power
from .spectrum import column_multiplicity as column_multiplicity
from .spectrum import each_plane as each_plane
from .spectrum import filtered as filtered
from .spectrum import frequencies as frequencies
from .spectrum import hann_autocorrelation as hann_autocorrelation
from .spectrum import hann_spectra as hann_spectra
from .spectrum import hann_tile as hann_tile
from .spectrum import natural_frequencies as natural_frequencies
from .spectrum import sharpened as sharpened
from .spectrum import squared_blur as squared_blur
from .spectrum import squared_frequencies as squared_frequencies
from .spectrum import tukey_window as tukey_window
