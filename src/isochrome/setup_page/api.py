"""`setup`: a local page on which a scene is set up on its frames."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from isochrome.errors import InputError
from isochrome.scene import LIBRARY, parse_toml, read_text, scene_names
from isochrome.setup_page.server import SetupServer
from isochrome.setup_page.session import TABLES, SetSession, SetupSession

_NAME, _SET_NAME = "scene.toml", "set.toml"
"""What a scene, and a calibration set, is called that is made on the page."""

SUBJECTS = {"beam": "bending", "disc": "diametral"}
"""What may be calibrated, and its kind of set."""


def setup(
    frames: str | Path | Sequence[str | Path],
    scene: str | Path | None = None,
    *,
    calibration: str | None = None,
    browser: bool = True,
    port: int = 0,
    announce: Callable[[str], None] | None = None,
) -> Path | None:
    """Open a local page on which a scene is set up on its frames.

    On the picture are set: the scale, the surface, the contact, the region of interest, a mask, and
    places of known order. The model's fringes lie over it and follow the sliders, a frame can be
    fitted, and `check` says what it thinks. With `calibration` it is a calibration set that is set
    up, of images at several loads: their loads, the beam's edges and rollers or the disc's rim, and
    what `calibrate` finds. The page is served to this machine alone; it reads the
    frames and the scene, and writes the scene when Save is pressed, comments kept. The call comes
    back when the page is closed, or on Ctrl-C.

    Parameters
    ----------
    frames : str, Path or sequence of them
        The captured frames, as for `open_frames`.
    scene : str or Path, optional
        A scene file, which need not be there yet, or the name of a scene of the package, whose copy
        becomes scene.toml. By default scene.toml beside the frames, or set.toml. A file that holds
        a calibration set is set up as one; it may stand alone in place of the frames.
    calibration : {'beam', 'disc'}, optional
        What is calibrated, where a calibration set is to be made.
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
    session = open_session(frames, scene, calibration=calibration)
    try:
        server = SetupServer(session, port)
    except (OSError, OverflowError) as error:
        raise InputError("port_cannot_used_machine", port=port, error=error) from error
    if announce is not None:
        announce(server.url)
    if browser:
        import webbrowser

        webbrowser.open(server.url)
    with suppress(KeyboardInterrupt):  # the user's way to end it, as good as closing the page
        server.run()
    return session.scene_file if session.saves else None


def open_session(
    frames: str | Path | Sequence[str | Path],
    scene: str | Path | None = None,
    *,
    calibration: str | None = None,
) -> SetupSession:
    """Open the frames, and the scene or calibration set where there is one, as for `setup`.

    The file of a calibration set is taken for frames too.
    """
    if calibration is not None and calibration not in SUBJECTS:
        raise InputError(
            "calibration_none_name_one", calibration=calibration, subjects=", ".join(SUBJECTS)
        )
    given = frames if isinstance(frames, str | Path) else tuple(frames)
    if scene is None and isinstance(given, str | Path) and Path(given).suffix.lower() == ".toml":
        scene, given = given, _images_of(Path(given))
    first = Path(given if isinstance(given, str | Path) else given[0])
    folder = first if first.is_dir() else first.parent
    if scene is not None and str(scene) in scene_names() and not Path(scene).exists():
        text = (LIBRARY / f"{scene}.toml").read_text("utf-8")
        return SetupSession(given, folder / _NAME, text, saved=False)
    place = Path(scene) if scene is not None else folder / (_SET_NAME if calibration else _NAME)
    return _session_of(given, place, calibration)


def _session_of(
    given: str | Path | tuple[str | Path, ...], place: Path, calibration: str | None
) -> SetupSession:
    """The session on a scene's or set's file, which may not be there yet."""
    content = _text_of(place)
    text, saved = content or "", content is not None
    subject = _subject(text, place, calibration)
    session = (
        SetupSession(given, place, text, saved=saved)
        if subject is None
        else SetSession(given, place, text, saved=saved, subject=subject)
    )
    if saved:
        session.scene()  # what is wrong with it is said before a page opens
    return session


def _text_of(place: Path) -> str | None:
    """The text of a scene's file, its line ends as they are; None where there is no file yet."""
    if place.is_dir() or not place.parent.is_dir():
        raise InputError("scene_cannot_written_there", place=place)
    if not place.is_file():
        return None
    read_text(place)  # its refusals: too large, a picture, not UTF-8
    return place.read_bytes().decode("utf-8-sig")


def _subject(text: str, place: Path, calibration: str | None) -> str | None:
    """The kind of set that a text is, or is to be; None for a scene."""
    holds = parse_toml(text, str(place)).keys() if text.strip() else ()
    (kind,) = [k for k, table in TABLES.items() if table in holds] or (None,)
    if calibration is None:
        return kind
    if holds and kind != SUBJECTS[calibration]:
        raise InputError("holds_no_so_no", place=place, calibration=calibration)
    return SUBJECTS[calibration]


def _images_of(place: Path) -> tuple[Path, ...]:
    """The images of a calibration set's file."""
    images = parse_toml(read_text(place), str(place)).get("image")
    files = [
        one.get("file")
        for one in (images if isinstance(images, list) else ())
        if isinstance(one, dict)
    ]
    if not files or not all(isinstance(file, str) for file in files):
        raise InputError("names_no_image_so", place=place)
    return tuple(place.parent / str(file) for file in files)
