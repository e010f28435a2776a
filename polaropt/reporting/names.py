"""Names of the files of a separation; this module imports nothing, so that they are known before anything is loaded."""

ERROR_MAPS = ("transmission_error.tiff", "reflection_error.tiff", "reflection_known.tiff", "uncertainty.png")
"""Files of how well the layers are known."""
RESULT_FILES = (
    "transmission.tiff",
    "transmission.png",
    "reflection.tiff",
    "reflection.png",
    *ERROR_MAPS,
    "misfit.tiff",
    "misfit.png",
    "moving.png",
    "unglazed.png",
    "report.json",
    "report.html",
)
"""All files that a separation may write: what of them a run does not write, an earlier one has left."""
THUMBNAIL = "thumbnail.jpg"
"""What a batch writes beside them, for its contact sheet."""
TRUE_LAYERS = ("true_transmission.tiff", "true_reflection.tiff")
"""What is written beside simulated photographs: the layers that they were made of."""
COMPARISON = "side-by-side.png"
"""Photographs, layers and truth of the demo, to look at."""
