from .explanations import Explanation, explain_message
from .pages import TOPICS, guide_page

__all__ = ["TOPICS", "Explanation", "explain_message", "guide_page"]
