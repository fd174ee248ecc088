from .api import Campaign, process_campaign
from .outcome import Outcome

__all__ = ["Campaign", "Outcome", "process_campaign"]
