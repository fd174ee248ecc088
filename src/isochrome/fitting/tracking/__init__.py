"""A video's frames one after the other, each followed from the one before."""
