from .api import SUMMARIES, Campaign, Outcome, folder_names, process_campaign

__all__ = ["SUMMARIES", "Campaign", "Outcome", "folder_names", "process_campaign"]
