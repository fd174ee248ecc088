"""Speed against error: this project beside the paper's own procedure (`isochrome bench`)."""
