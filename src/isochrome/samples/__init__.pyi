from .render import SEED, render_samples, samples_path

__all__ = ["SEED", "render_samples", "samples_path"]
