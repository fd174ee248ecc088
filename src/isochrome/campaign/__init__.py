"""Many recordings by one scene: each a run of `process` in its own folder, and a table of all."""

from isochrome.campaign.run import Campaign, process_campaign

__all__ = ["Campaign", "process_campaign"]
