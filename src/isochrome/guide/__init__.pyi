from .api import TOPICS, guide_page

__all__ = ["TOPICS", "guide_page"]
