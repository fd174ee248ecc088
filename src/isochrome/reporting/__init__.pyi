from .assembly import assemble_page, content_policy
from .charts import Curve, curves_of, make_curve
from .content import ReportContent, ReportTable, warnings_with_remedies
from .frame_choice import MOST_FRAMES, ChosenFrame, choose_frames
from .page import report_html, write_report
from .paper_table import camera_rows, paper_rows
from .pictures import (
    FRINGES,
    GREY_LEVELS,
    SIGNAL,
    OrderMap,
    Pane,
    ReportFrame,
    encode_frames,
    order_map,
)

__all__ = [
    "FRINGES",
    "GREY_LEVELS",
    "MOST_FRAMES",
    "SIGNAL",
    "ChosenFrame",
    "Curve",
    "OrderMap",
    "Pane",
    "ReportContent",
    "ReportFrame",
    "ReportTable",
    "assemble_page",
    "camera_rows",
    "choose_frames",
    "content_policy",
    "curves_of",
    "encode_frames",
    "make_curve",
    "order_map",
    "paper_rows",
    "report_html",
    "warnings_with_remedies",
    "write_report",
]
