"""`python -m isochrome` is the command line."""

from isochrome.cli import main

if __name__ == "__main__":
    main()
