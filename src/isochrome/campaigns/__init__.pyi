from .api import Campaign, process_campaign

__all__ = ["Campaign", "process_campaign"]
