"""`setup`: a local page on which a scene is set up on its frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from isochrome.errors import InputError
from isochrome.scene import LIBRARY, read_text, scene_names
from isochrome.setup_page.server import SetupServer
from isochrome.setup_page.session import SetupSession

_NAME = "scene.toml"
"""What a scene is called that is made on the page."""


def setup(
    frames: str | Path | Sequence[str | Path],
    scene: str | Path | None = None,
    *,
    browser: bool = True,
    port: int = 0,
    announce: Callable[[str], None] | None = None,
) -> Path | None:
    """Open a local page on which a scene is set up on its frames.

    On the picture are set: the scale, the surface, the contact, the region of interest, a mask, and
    places of known order. The model's fringes lie over it and follow the sliders, a frame can be
    fitted, and `check` says what it thinks. The page is served to this machine alone; it reads the
    frames and the scene, and writes the scene when Save is pressed, comments kept. The call comes
    back when the page is closed, or on Ctrl-C.

    Parameters
    ----------
    frames : str, Path or sequence of them
        The captured frames, as for `open_frames`.
    scene : str or Path, optional
        A scene file, which need not be there yet, or the name of a scene of the package, whose copy
        becomes scene.toml. By default scene.toml beside the frames.
    browser : bool, default True
        Whether to open the page in the browser.
    port : int, default 0
        Port on the loopback address; 0: a free one.
    announce : callable, optional
        Called with the page's address once it can be opened.

    Returns
    -------
    Path or None
        The scene file; None where nothing was saved.

    Raises
    ------
    InputError
        Where the frames or the scene cannot be read, or the port is taken.

    Examples
    --------
    >>> import isochrome
    >>> isochrome.setup("captured.tif", browser=False, announce=print)  # doctest: +SKIP
    http://127.0.0.1:40325/R9dEzNpqYTHa5FgYgbHkcrnLhLxBr6dQ/
    PosixPath('scene.toml')
    """
    session = open_session(frames, scene)
    try:
        server = SetupServer(session, port)
    except (OSError, OverflowError) as error:
        raise InputError(
            f"--port {port}: cannot be used on this machine ({error}); leave it out, and a free "
            "one is taken"
        ) from error
    if announce is not None:
        announce(server.url)
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    with suppress(KeyboardInterrupt):  # the user's way to end it, as good as closing the page
        server.run()
    return session.scene_file if session.saves else None


def open_session(
    frames: str | Path | Sequence[str | Path], scene: str | Path | None = None
) -> SetupSession:
    """Open the frames, and the scene where there is one.

    Parameters
    ----------
    frames : str, Path or sequence of them
        The captured frames.
    scene : str or Path, optional
        As for `setup`.

    Returns
    -------
    SetupSession
        What the page works on.

    Raises
    ------
    InputError
        Where the frames or the scene cannot be read.
    """
    given = frames if isinstance(frames, str | Path) else tuple(frames)
    first = Path(given if isinstance(given, str | Path) else given[0])
    folder = first if first.is_dir() else first.parent
    if scene is not None and str(scene) in scene_names() and not Path(scene).exists():
        text = (LIBRARY / f"{scene}.toml").read_text("utf-8")
        return SetupSession(given, folder / _NAME, text, saved=False)
    place = folder / _NAME if scene is None else Path(scene)
    if place.is_dir() or not place.parent.is_dir():
        raise InputError(
            f"{place}: a scene cannot be written there; name a .toml file in a folder that exists"
        )
    there = place.is_file()
    if there:
        read_text(place)  # its refusals: too large, a picture, not UTF-8
    # line ends stay as they are
    text = place.read_bytes().decode("utf-8-sig") if there else ""
    session = SetupSession(given, place, text, saved=there)
    if there:
        session.scene()  # what is wrong with it is said before a page opens
    return session
