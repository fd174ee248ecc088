"""Scene files that are none, or that ask for what no machine has."""

from pathlib import Path

import numpy as np

from hostile.attack import Case, after, case, hostile
from hostile.given import (
    CONTACT,
    contact_with,
    image,
    picture,
    process,
    simulate,
    stack,
    write_scene,
)

SCENES: list[Case] = []


case(SCENES, "scene of a hundred megabytes",
     after(lambda p: write_scene(p, CONTACT + "# " + "x" * 100_000_000 + "\n"), simulate()),
     "wrong.toml", "larger than", "settings file")  # fmt: skip
case(SCENES, "scene nested a hundred thousand deep",
     after(lambda p: write_scene(p, CONTACT + "deep = " + "[" * 100_000 + "]" * 100_000 + "\n"),
     simulate()), "wrong.toml", "not valid TOML")  # fmt: skip
case(SCENES, "scene of tables nested ten thousand deep",
     after(lambda p: write_scene(p, CONTACT + "[" + ".".join("a" * 10_000) + "]\nb = 1\n"),
     simulate()), "wrong.toml")  # fmt: skip
case(SCENES, "scene of fifty thousand keys",
     after(lambda p: write_scene(p, CONTACT + "".join(f"k{n} = {n}\n" for n in range(50_000))),
     simulate()), "wrong.toml", "unknown key")  # fmt: skip
case(SCENES, "scene of a million keys",
     after(lambda p: write_scene(p, CONTACT + "".join(f"k{n} = {n}\n" for n in range(1_000_000))),
     simulate()), "wrong.toml", "larger than", "settings file")  # fmt: skip
case(SCENES, "scene with nul bytes",
     after(lambda p: write_scene(p, CONTACT.replace("44.0", "44.0\0")), simulate()), "wrong.toml",
     "not valid TOML", "correct that line")  # fmt: skip
case(SCENES, "scene in another encoding",
     after(lambda p: (p / "wrong.toml").write_bytes(("# Öl\n" + CONTACT).encode("utf-16")),
     simulate()), "wrong.toml", "save it as UTF-8")  # fmt: skip
case(SCENES, "scene with a key twice",
     after(lambda p: contact_with(p, "normal_n = 44.0", "normal_n = 44.0\nnormal_n = 55.0"),
     simulate()), "wrong.toml", "not valid TOML", "correct that line")  # fmt: skip
case(SCENES, "scene with a table twice",
     after(lambda p: write_scene(p, CONTACT + "[load]\nnormal_n = 3.0\n"), simulate()),
     "wrong.toml", "not valid TOML", "correct that line")  # fmt: skip
case(SCENES, "empty scene", after(lambda p: write_scene(p, ""), simulate()), "wrong.toml",
     "specimen", "missing")  # fmt: skip


def number(name: str, old: str, new: str, *says: str, code: int = 2) -> None:
    """A scene of which one line is another."""

    def make(place: Path) -> list[str]:
        contact_with(place, old, new)
        return simulate()

    SCENES.append(Case(make, says, code=code, label=name))


LOAD = "normal_n = 44.0"
REACH = "its size should lie between 1e-30 and 1e+30"
number("load of no number", LOAD, "normal_n = nan", "load.normal_n", "correct it")
number("infinite load", LOAD, "normal_n = inf", "load.normal_n", "correct it")
number("load of 1e308", LOAD, "normal_n = 1e308", "load.normal_n", REACH)
number("load of 1e-308", LOAD, "normal_n = 1e-308", "load.normal_n", REACH)
number("load of text", LOAD, "normal_n = 'much'", "load.normal_n", "correct it")
number("load of a date", LOAD, "normal_n = 2024-02-30", "wrong.toml", "correct that line")
number("load of a time", LOAD, "normal_n = 07:32:00", "load.normal_n", "correct it")
number("load of a table", LOAD, "normal_n = {n = 4}", "load.normal_n", "known here")
number("load of 5000 digits", LOAD, f"normal_n = {'9' * 5000}", "wrong.toml", "digits")
number("load of 400 digits", LOAD, f"normal_n = {'9' * 400}", "load.normal_n", "correct it")
number("load of true", LOAD, "normal_n = true", "load.normal_n", "correct it")
number("radius of zero", "radius_mm = 24.61", "radius_mm = 0", "radius_mm", "correct it")
number("radius of 1e308", "radius_mm = 24.61", "radius_mm = 1e308", "indenter.radius_mm", REACH)
number("poisson of over a half", "poisson = 0.4", "poisson = 0.51", "poisson", "correct it")
number("fringe value of 1e-300", "mm = 14.6", "mm = 1e-300", "fringe_value_n_per_mm", REACH)
number("friction of a hundred", "cient = 0.25", "cient = 100.0", "friction.coefficient")
number("negative wear", "n = 2e-9", "n = -2e-9", "wear.coefficient_mm2_per_n", "correct it")
number("distance of 1e308", "[0.0, 77.0]", "[0.0, 1e308]", "wear.distances_m[2]", REACH)
number("distances of no number", "[0.0, 77.0]", "[0.0, nan]", "wear.distances_m")
number("no distance", "[0.0, 77.0]", "[]", "wear.distances_m", "correct it")
number("distances in a text", "[0.0, 77.0]", "'far'", "wear.distances_m", "correct it")
number("camera of a million square", "width_px = 64", "width_px = 1000000", "camera.width_px")
number("wavelength of an X-ray", "nm = 587.0", "nm = 0.1", "polariscope.wavelength_nm")
number("seventeen bits", "bit_depth = 8", "bit_depth = 17", "camera.bit_depth", "correct it")
number("bits and a half", "bit_depth = 8", "bit_depth = 8.5", "camera.bit_depth", "correct it")
number("key of another table", LOAD, "normal_n = 44.0\npixel_mm = 2", "load.pixel_mm", "known here")

# within reach of numbers, and out of that of physics or memory
number("load of 1e29", LOAD, "normal_n = 1e29", "load.normal_n", "lower", code=3)
number("load of 1e-29", LOAD, "normal_n = 1e-29", "nodes", "numerics", code=3)
number("radius of 1e29", "radius_mm = 24.61", "radius_mm = 1e29", "in mm")
number("radius of 1e-29", "radius_mm = 24.61", "radius_mm = 1e-29", "raise", code=3)
number("specimen softer than air", "young_gpa = 2.1", "young_gpa = 1e-29", "lower", code=3)
number("specimen harder than all", "young_gpa = 2.1", "young_gpa = 1e29", "no solid")
number("fringe value of 1e-29", "mm = 14.6", "mm = 1e-29", "finer than two pixels", code=3)
number("thickness of 1e29", "thickness_mm = 4.0", "thickness_mm = 1e29", "in mm")
number("wear of 1e-2", "n = 2e-9", "n = 1e-2", "lower load.normal_n or the wear", code=3)
number("wear of 1e29", "n = 2e-9", "n = 1e29", "lower load.normal_n or the wear", code=3)
number("distance of 1e29", "[0.0, 77.0]", "[0.0, 1e29]", "the wear", code=3)
number("pixel of 1e-29 mm", "pixel_mm = 0.05", "pixel_mm = 1e-29", "camera.pixel_mm", "not in m")
number("pixel of 1e29 mm", "pixel_mm = 0.05", "pixel_mm = 1e29", "camera.pixel_mm", "in mm")
number("picture at 1e29 mm", "left_mm = -1.6", "left_mm = 1e29", "camera.left_mm", "in mm")
number("nodes of 1e-9 mm", "[load]", "[numerics]\nspacing_mm = 1e-9\n[load]", "nodes", code=3)
number("tolerance of 0", "[load]", "[numerics]\ntolerance = 0.0\n[load]", "numerics.tolerance")
number("spacing of NaN", "[load]", "[numerics]\nspacing_mm = nan\n[load]", "numerics.spacing_mm")
case(SCENES, "a million wear states",
     after(lambda p: contact_with(p, "[0.0, 77.0]", str([float(n) for n in range(1_000_000)])),
     simulate()), "wrong.toml", "larger than", "settings file")  # fmt: skip


@hostile(SCENES, "camera.width_px x height_px", "lower them")
def camera_of_ten_gigapixels(place: Path) -> list[str]:
    text = CONTACT.replace("width_px = 64", "width_px = 100000")
    write_scene(place, text.replace("height_px = 48", "height_px = 100000"))
    return simulate()


def with_frames(place: Path, text: str, name: str = "f.tif") -> list[str]:
    """Good frames, and a scene of this text."""
    stack(place / "f.tif")
    write_scene(place, "[specimen]\n" + text)
    return process(name, "wrong.toml")


def polygon(name: str, corners: str, *says: str) -> None:
    SCENES.append(
        Case(lambda p: with_frames(p, f"[frames]\npolygon_px = {corners}\n"), says, label=name)
    )


polygon("polygon whose sides cross", "[[5,5],[40,40],[5,40],[40,5]]", "polygon_px", "in order")
polygon("polygon on a line", "[[5,5],[20,20],[40,40]]", "polygon_px", "do not lie on one line")
polygon("polygon of two corners", "[[5,5],[20,20]]", "polygon_px", "3")
polygon("polygon outside the frame", "[[500,5],[600,5],[600,60]]", "polygon_px", "region")
polygon(
    "polygon around all at 1e308",
    "[[-1e308,-1e308],[-1e308,1e308],[1e308,1e308],[1e308,-1e308]]",
    "",
)
polygon("polygon of no numbers", "[[nan,5],[20,20],[40,5]]", "polygon_px", "correct it")
polygon(
    "polygon of three thousand corners", str([[k % 2, k] for k in range(3000)]), "3000 corners",
    "draw it with fewer",
)  # fmt: skip
case(SCENES, "region outside the frame",
     lambda p: with_frames(p, "[frames]\nroi = {top_px=40, left_px=0, height_px=20, width_px=9}\n"),
     "roi", "lies outside the frame", "correct frames.roi")  # fmt: skip
case(SCENES, "region at minus one",
     lambda p: with_frames(p, "[frames]\nroi = {top_px=-1, left_px=0, height_px=20, width_px=9}\n"),
     "frames.roi", "correct it")  # fmt: skip
case(SCENES, "region of no rows",
     lambda p: with_frames(p, "[frames]\nroi = {top_px=0, left_px=0, height_px=0, width_px=9}\n"),
     "frames.roi", "correct it")  # fmt: skip
case(SCENES, "no load frame that is missing",
     lambda p: with_frames(p, "[frames]\nno_load_dark = 'gone.tif'\n"), "gone.tif", "no such file",
     "check its name")  # fmt: skip
case(SCENES, "no load frame of another size",
     after(lambda p: image(p / "dark.png", picture(rows=20)),
     lambda p: with_frames(p, "[frames]\nno_load_dark = 'dark.png'\n")), "dark.png", "no_load_dark",
     "capture both with the same camera settings")  # fmt: skip
case(SCENES, "no load frame that is a device",
     lambda p: with_frames(p, "[frames]\nno_load_dark = '/dev/zero'\n"), "/dev/zero",
     "cannot be read")  # fmt: skip
case(SCENES, "no load frame without a name",
     lambda p: with_frames(p, "[frames]\nno_load_dark = ''\n"), "no_load_dark", "")  # fmt: skip
case(SCENES, "no load frame of nan",
     after(lambda p: stack(p / "dark.tif", np.full((1, 48, 64), np.nan, np.float32)),
     lambda p: with_frames(p, "[frames]\nno_load_dark = 'dark.tif'\n")), "dark.tif", "NaN",
     "check")  # fmt: skip
case(SCENES, "known order outside the frame",
     lambda p: with_frames(p, "[[frames.known_order]]\nrow_px = 480\ncol_px = 2\norder = 1.0\n"),
     "known_order", "outside")  # fmt: skip


@hostile(SCENES, "mask", "")
def mask_that_is_a_pipe(place: Path) -> list[str]:
    import os

    os.mkfifo(place / "m.png")
    return with_frames(place, "[frames]\nmask = 'm.png'\n")
