"""What else a frame shows than its scene says: asked of its residual, freed, named."""
