"""The command line in this process."""

from isochrome.cli import main


def exit_code(monkeypatch, *arguments):
    """Run a command; the code that it exits with."""
    monkeypatch.setattr("sys.argv", ["isochrome", *map(str, arguments)])
    try:
        main()
    except SystemExit as end:
        return end.code
    return 0
