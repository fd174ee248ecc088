"""Results on disk: whole, or not at all.

Every file is written beside its place under a hidden name and renamed when it is complete, so
that a crash or a full disk leaves no half-written result. Heavy libraries are imported inside
the functions that need them.
"""

from isochrome.output.files import (
    check_link,
    json_pieces,
    output_folder,
    plain,
    replacing,
    staged,
    write_json,
    write_text,
)
from isochrome.output.record import provenance, sha256, write_figure
from isochrome.output.scale import pixel_mm_of, read_pixel_mm
from isochrome.output.tables import (
    Floats,
    TableWriter,
    check_given_table,
    csv_text,
    numbers,
    read_csv,
    write_csv,
)
from isochrome.output.tiff import Photometric, TiffWriter, write_tiff

__all__ = [
    "Floats",
    "Photometric",
    "TableWriter",
    "TiffWriter",
    "check_given_table",
    "check_link",
    "csv_text",
    "json_pieces",
    "numbers",
    "output_folder",
    "pixel_mm_of",
    "plain",
    "provenance",
    "read_csv",
    "read_pixel_mm",
    "replacing",
    "sha256",
    "staged",
    "write_csv",
    "write_figure",
    "write_json",
    "write_text",
    "write_tiff",
]
