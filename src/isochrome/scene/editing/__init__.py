"""Values set in a scene's text, whose comments and layout stay as they are."""
