from .charts import Curve, curves_of, make_curve
from .content import ReportContent, ReportTable, camera_rows, paper_rows, warnings_with_remedies
from .page import assemble_page, content_policy, report_html, write_report
from .pictures import (
    FRINGES,
    GREY_LEVELS,
    MOST_FRAMES,
    SIGNAL,
    ChosenFrame,
    OrderMap,
    Pane,
    ReportFrame,
    choose_frames,
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
