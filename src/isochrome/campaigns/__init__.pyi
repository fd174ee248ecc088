from .api import SUMMARIES, Campaign, Outcome, folder_names, process_campaign, summary_figure

__all__ = ["SUMMARIES", "Campaign", "Outcome", "folder_names", "process_campaign", "summary_figure"]
