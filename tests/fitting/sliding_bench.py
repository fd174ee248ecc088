"""The sliding contact whose frames `outside_camera` takes."""

from functools import lru_cache

from isochrome.scene import load_scene

LOAD, FRICTION = 47.3, 0.187


@lru_cache
def bench(rows=247, cols=330):
    """A sliding contact of 4 mm x 3 mm in view."""
    scene = load_scene("line-contact-wear").with_values(
        {
            "load.normal_n": LOAD, "friction.coefficient": FRICTION,
            "friction.static_state_first": False, "wear.distances_m": (0.0,),
            "polariscope.wavelength_nm": 587.0, "camera.width_px": cols, "camera.height_px": rows,
            "camera.pixel_mm": 4.0 / cols,
        }
    )  # fmt: skip
    return scene.model_copy(update={"wear": None})
