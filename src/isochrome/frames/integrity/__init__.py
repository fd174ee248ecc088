"""Whether a video is whole, and where each of its frames is."""
