from .api import Campaign, process_campaign
from .figure import summary_figure
from .outcome import SUMMARIES, Outcome, folder_names

__all__ = ["SUMMARIES", "Campaign", "Outcome", "folder_names", "process_campaign", "summary_figure"]
