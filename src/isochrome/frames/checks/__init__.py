"""What is wrong with a set of frames, before a long run."""
