from .api import TOPICS, atlas_file, atlas_picture, guide_page

__all__ = ["TOPICS", "atlas_file", "atlas_picture", "guide_page"]
