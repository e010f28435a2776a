__all__ = [
    "capture_of",
    "layers_of_capture",
    "layers_of_folder",
    "layers_of_result",
    "reader_of",
    "separated_layers",
    "separation_widget",
]

from .layers import layers_of_capture as layers_of_capture
from .layers import layers_of_result as layers_of_result
from .reader import layers_of_folder as layers_of_folder
from .reader import reader_of as reader_of
from .widget import capture_of as capture_of
from .widget import separated_layers as separated_layers
from .widget import separation_widget as separation_widget
