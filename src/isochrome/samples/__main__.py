"""`python -m isochrome.samples OUT`: render every sample image."""

import argparse
import sys

from isochrome.errors import IsochromeError
from isochrome.samples.shipped import SEED, render_samples


def main() -> int:
    """Read the arguments, render, and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m isochrome.samples",
        description="Render the sample images: the same seed gives the same files.",
    )
    parser.add_argument("out", help="folder for the files; made if missing")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of the noise (default {SEED})")
    given = parser.parse_args()
    try:
        folder = render_samples(given.out, seed=given.seed)
    except IsochromeError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
