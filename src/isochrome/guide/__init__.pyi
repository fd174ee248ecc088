from .pages import TOPICS, Explanation, explain_message, guide_page

__all__ = ["TOPICS", "Explanation", "explain_message", "guide_page"]
