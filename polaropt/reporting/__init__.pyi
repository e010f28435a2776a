__all__ = [
    "COMPARISON",
    "LAYERS",
    "RESULT_FILES",
    "THUMBNAIL",
    "TRUE_LAYERS",
    "Inspection",
    "Picture",
    "alignment_sentence",
    "capture_findings",
    "cell_order_attention",
    "estimate_sentences",
    "explained_attention",
    "grey_means",
    "inspect_capture",
    "inspection_picture",
    "inspection_sentences",
    "json_values",
    "marked",
    "matching_report",
    "matching_sentences",
    "motion_attention",
    "motion_sentences",
    "page_template",
    "plot_layers",
    "reduced_intensity",
    "report_attention",
    "report_sentences",
    "result_html",
    "result_lines",
    "result_sentences",
    "scene_of_report",
    "scene_report",
    "side_by_side",
    "start_sentence",
    "thumbnail_strip",
    "time_sentence",
    "unglazed_sentences",
    "unglazed_share",
    "viewing_exposure",
    "write_separation",
]

from .files import write_separation as write_separation
from .inspection import Inspection as Inspection
from .inspection import inspect_capture as inspect_capture
from .names import COMPARISON as COMPARISON
from .names import RESULT_FILES as RESULT_FILES
from .names import THUMBNAIL as THUMBNAIL
from .names import TRUE_LAYERS as TRUE_LAYERS
from .notebook import plot_layers as plot_layers
from .notebook import result_html as result_html
from .notebook import result_lines as result_lines
from .notebook import scene_of_report as scene_of_report
from .page import page_template as page_template
from .pictures import LAYERS as LAYERS
from .pictures import Picture as Picture
from .pictures import grey_means as grey_means
from .pictures import inspection_picture as inspection_picture
from .pictures import reduced_intensity as reduced_intensity
from .pictures import side_by_side as side_by_side
from .pictures import thumbnail_strip as thumbnail_strip
from .pictures import viewing_exposure as viewing_exposure
from .report import json_values as json_values
from .report import matching_report as matching_report
from .report import scene_report as scene_report
from .report import unglazed_share as unglazed_share
from .words import alignment_sentence as alignment_sentence
from .words import capture_findings as capture_findings
from .words import cell_order_attention as cell_order_attention
from .words import estimate_sentences as estimate_sentences
from .words import explained_attention as explained_attention
from .words import inspection_sentences as inspection_sentences
from .words import marked as marked
from .words import matching_sentences as matching_sentences
from .words import motion_attention as motion_attention
from .words import motion_sentences as motion_sentences
from .words import report_attention as report_attention
from .words import report_sentences as report_sentences
from .words import result_sentences as result_sentences
from .words import start_sentence as start_sentence
from .words import time_sentence as time_sentence
from .words import unglazed_sentences as unglazed_sentences
