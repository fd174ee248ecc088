"""Pictures of a processed set: the figure of a run, and panels for a paper."""
