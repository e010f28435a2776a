__all__ = [
    "ANGLES_DEG",
    "CAMERA_RAW",
    "HEIF",
    "LEAST_STOKES_POWER",
    "LINEAR_LIGHT",
    "MAX_PIXELS",
    "MIRRORED_PX",
    "MOST_NEGATIVE",
    "PLAUSIBLE_GAIN",
    "SMALLEST_SIDE",
    "SONY_CELL",
    "STOKES_SAMPLED",
    "STOKES_START",
    "STOKES_TURNS",
    "WHITE_16",
    "AnyPath",
    "CameraFacts",
    "Capture",
    "Decoder",
    "EncodingHint",
    "FileContent",
    "FloatImages",
    "FrameReader",
    "GammaFit",
    "JpegFacts",
    "LayerShifts",
    "Matching",
    "Mistakes",
    "NoiseClasses",
    "NoiseModel",
    "NoiseSpectrum",
    "Origin",
    "PlateFrame",
    "RawSamples",
    "RegisteredCells",
    "Shifts",
    "StokesImages",
    "Transfer",
    "agree_as_wholes",
    "align",
    "angles_of",
    "blocks_of",
    "check_angles",
    "check_capture",
    "closure_share",
    "colour_blocks",
    "correlated_noise",
    "encode_srgb",
    "exchanged_order",
    "far_motions",
    "field_means",
    "find_mistakes",
    "fit_gamma",
    "frame_sides",
    "grey_levels",
    "headless_frames",
    "least_squares_entries",
    "linearize",
    "look_swapped_in_place",
    "low_pass",
    "match_photographs",
    "may_lie_apart",
    "measured_noise",
    "mirrored_patterns",
    "mosaic_capture",
    "moved_onto_first",
    "natural_law",
    "noise_classes",
    "noise_level",
    "noise_of_blocks",
    "noise_of_neighbours",
    "noise_of_rounded_blocks",
    "orthogonal_pairs",
    "pair_gain_of",
    "pair_signs",
    "parse_gamma",
    "parsed_json",
    "planes_first",
    "planes_last",
    "plate_frame",
    "read_capture",
    "read_file",
    "read_headless",
    "read_json",
    "redundancy_residual",
    "registered_noise",
    "result_file",
    "result_folder",
    "sampling_of",
    "shifts_in_the_middle",
    "shown_by_all",
    "stokes_images",
    "swapped_photographs",
    "tiff_frames",
    "tiff_rows",
    "trusted_blocks",
    "uneven_gains",
    "visible_shift",
    "write_bytes",
    "write_capture",
    "write_picture",
    "write_png",
    "write_png_view",
    "write_tiff",
]

from .alignment import align as align
from .alignment import moved_onto_first as moved_onto_first
from .alignment import shown_by_all as shown_by_all
from .capture import ANGLES_DEG as ANGLES_DEG
from .capture import Capture as Capture
from .capture import EncodingHint as EncodingHint
from .capture import FileContent as FileContent
from .capture import Origin as Origin
from .capture import RawSamples as RawSamples
from .capture import RegisteredCells as RegisteredCells
from .capture import check_capture as check_capture
from .capture import grey_levels as grey_levels
from .capture import planes_first as planes_first
from .capture import planes_last as planes_last
from .checks import GammaFit as GammaFit
from .checks import Mistakes as Mistakes
from .checks import blocks_of as blocks_of
from .checks import find_mistakes as find_mistakes
from .checks import fit_gamma as fit_gamma
from .checks import swapped_photographs as swapped_photographs
from .checks import visible_shift as visible_shift
from .exposure import uneven_gains as uneven_gains
from .files.decode import Decoder as Decoder
from .files.decode import read_file as read_file
from .files.encoding import linearize as linearize
from .files.encoding import parse_gamma as parse_gamma
from .files.exif import CameraFacts as CameraFacts
from .files.formats.camera_raw import CAMERA_RAW as CAMERA_RAW
from .files.formats.heif import HEIF as HEIF
from .files.formats.tiff import tiff_frames as tiff_frames
from .files.headless import headless_frames as headless_frames
from .files.headless import read_headless as read_headless
from .files.jpeg import JpegFacts as JpegFacts
from .files.limits import MAX_PIXELS as MAX_PIXELS
from .files.opening import AnyPath as AnyPath
from .files.opening import parsed_json as parsed_json
from .files.opening import read_json as read_json
from .files.results import result_file as result_file
from .files.results import result_folder as result_folder
from .files.write import LINEAR_LIGHT as LINEAR_LIGHT
from .files.write import encode_srgb as encode_srgb
from .files.write import tiff_rows as tiff_rows
from .files.write import write_bytes as write_bytes
from .files.write import write_capture as write_capture
from .files.write import write_picture as write_picture
from .files.write import write_png as write_png
from .files.write import write_png_view as write_png_view
from .files.write import write_tiff as write_tiff
from .matching.match import Matching as Matching
from .matching.match import agree_as_wholes as agree_as_wholes
from .matching.match import far_motions as far_motions
from .matching.match import look_swapped_in_place as look_swapped_in_place
from .matching.match import match_photographs as match_photographs
from .matching.match import may_lie_apart as may_lie_apart
from .matching.match import shifts_in_the_middle as shifts_in_the_middle
from .matching.transfer import LayerShifts as LayerShifts
from .matching.transfer import Transfer as Transfer
from .mosaic import LEAST_STOKES_POWER as LEAST_STOKES_POWER
from .mosaic import MIRRORED_PX as MIRRORED_PX
from .mosaic import SONY_CELL as SONY_CELL
from .mosaic import STOKES_SAMPLED as STOKES_SAMPLED
from .mosaic import STOKES_START as STOKES_START
from .mosaic import STOKES_TURNS as STOKES_TURNS
from .mosaic import WHITE_16 as WHITE_16
from .mosaic import exchanged_order as exchanged_order
from .mosaic import frame_sides as frame_sides
from .mosaic import low_pass as low_pass
from .mosaic import mirrored_patterns as mirrored_patterns
from .mosaic import natural_law as natural_law
from .mosaic import sampling_of as sampling_of
from .noise import NoiseClasses as NoiseClasses
from .noise import NoiseModel as NoiseModel
from .noise import measured_noise as measured_noise
from .noise import noise_classes as noise_classes
from .noise import noise_level as noise_level
from .noise import noise_of_blocks as noise_of_blocks
from .noise import noise_of_rounded_blocks as noise_of_rounded_blocks
from .noise import registered_noise as registered_noise
from .noise_spectrum import NoiseSpectrum as NoiseSpectrum
from .noise_spectrum import correlated_noise as correlated_noise
from .pair_gain import PLAUSIBLE_GAIN as PLAUSIBLE_GAIN
from .pair_gain import closure_share as closure_share
from .pair_gain import colour_blocks as colour_blocks
from .pair_gain import orthogonal_pairs as orthogonal_pairs
from .pair_gain import pair_gain_of as pair_gain_of
from .pair_gain import pair_signs as pair_signs
from .pair_gain import redundancy_residual as redundancy_residual
from .pair_gain import trusted_blocks as trusted_blocks
from .polarization import PlateFrame as PlateFrame
from .polarization import StokesImages as StokesImages
from .polarization import least_squares_entries as least_squares_entries
from .polarization import noise_of_neighbours as noise_of_neighbours
from .polarization import plate_frame as plate_frame
from .polarization import stokes_images as stokes_images
from .read import read_capture as read_capture
from .reading.fields import field_means as field_means
from .reading.frames import FrameReader as FrameReader
from .reading.frames import mosaic_capture as mosaic_capture
from .registration import Shifts as Shifts
from .validity import MOST_NEGATIVE as MOST_NEGATIVE
from .validity import SMALLEST_SIDE as SMALLEST_SIDE
from .validity import FloatImages as FloatImages
from .validity import angles_of as angles_of
from .validity import check_angles as check_angles
