from .canvas import TiffCanvas, make_canvas, open_canvas
from .files import (
    check_link,
    json_pieces,
    output_folder,
    plain,
    replacing,
    staged,
    write_json,
    write_text,
)
from .frame_names import counted_frames, messages_of_frames, named_frames
from .frame_values import FrameValues
from .given_table import GivenTable, numbered_lines, read_given_table, read_given_text
from .record import InputContent, provenance, sha256, write_figure
from .result import (
    FIGURE_DPI,
    Result,
    counted,
    over_items,
    per_cent,
    rounded_texts,
    saved_picture,
    with_uncertainty,
)
from .roi import SUFFIXES, add_rois, load_roifile, read_roi_mask, roi_entries
from .scale import pixel_mm_of, read_pixel_mm
from .sentence import sentence_of, sentence_of_orders, sentence_of_values
from .tables import (
    Floats,
    check_given_table,
    csv_text,
    numbers,
    read_csv,
    write_csv,
    write_excel_copies,
)
from .tiff_stack import Photometric, add_imagej_view, imagej_view, write_frames, write_tiff

__all__ = [
    "FIGURE_DPI",
    "SUFFIXES",
    "Floats",
    "FrameValues",
    "GivenTable",
    "InputContent",
    "Photometric",
    "Result",
    "TiffCanvas",
    "add_imagej_view",
    "add_rois",
    "check_given_table",
    "check_link",
    "counted",
    "counted_frames",
    "csv_text",
    "imagej_view",
    "json_pieces",
    "load_roifile",
    "make_canvas",
    "messages_of_frames",
    "named_frames",
    "numbered_lines",
    "numbers",
    "open_canvas",
    "output_folder",
    "over_items",
    "per_cent",
    "pixel_mm_of",
    "plain",
    "provenance",
    "read_csv",
    "read_given_table",
    "read_given_text",
    "read_pixel_mm",
    "read_roi_mask",
    "replacing",
    "roi_entries",
    "rounded_texts",
    "saved_picture",
    "sentence_of",
    "sentence_of_orders",
    "sentence_of_values",
    "sha256",
    "staged",
    "with_uncertainty",
    "write_csv",
    "write_excel_copies",
    "write_figure",
    "write_frames",
    "write_json",
    "write_text",
    "write_tiff",
]
