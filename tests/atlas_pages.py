"""Make the guide's atlas of residuals: `python tests/atlas_pages.py [NAME ...]`.

Each page's fact is put into the paper's contact (44 N on 4 mm, friction 0.25), or a ring; the frame
is rendered with noise and fitted without it. The pictures, and the page with what was measured, go
into the package.
"""

import io
import sys
import tomllib
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from PIL import Image

from isochrome import figures, load_scene
from isochrome.estimation import prepare_frame
from isochrome.fitting import evaluate_model, fit_frame
from isochrome.fitting.causes.cause import CAUSES
from isochrome.fitting.frame.renderer import SceneRenderer
from isochrome.frames import Frame
from isochrome.guide import atlas_file
from isochrome.optics import blurred
from isochrome.scene import dump_scene
from isochrome.simulation import make_picture, picture_signal
from isochrome.stress import pixel_grid

WORDS = Path(__file__).parent / "guide" / "atlas.toml"
GUIDE = Path(figures.__file__).parents[1] / "guide"
COLOURS, GREYS = 25, 7
MEAN = 3
"""Pixels along the side of a square of the pictures."""

NOISE, LIGHT, DARK, BITS = 3.0, 190.0, 12.0, 8
"""Of a grey level; and of the light's span and foot."""

KEYS = {cause.name: cause.keys for cause in CAUSES}

FACTS = {
    "the camera's roll": {"camera.roll_deg": 1.0},
    "the lens's distortion": {"camera.distortion": 0.02},
    "a camera that looks from the side": {"camera.keystone_x": 0.01},
    "a camera that looks from above or below": {"camera.keystone_z": 0.01},
    "the camera's tone curve": {"frames.gamma": 1.2},
    "blur": {"camera.blur_px": 1.0},
    "quarter-wave plates that are turned": {
        "polariscope.input_plate_error_deg": 8.0, "polariscope.output_plate_error_deg": 8.0
    },
    "the light's band of wavelengths": {"polariscope.bandwidth_nm": 40.0},
    "a smooth stress besides the contact's": {"load.bulk_mpa": 0.2},
    "another friction before": {"friction.earlier_change": 0.2},
    "another modulus of the specimen, or another radius of what presses on it": {
        "specimen.young_gpa": 2.037
    },
    "a soft or rough layer between the bodies": {"contact.layer_um_per_mpa": 0.02},
    "rough surfaces": {"contact.roughness_um": 0.1},
    "stress along a machined surface": {
        "specimen.edge_stress_mpa": 0.2, "specimen.edge_depth_mm": 0.3
    },
    "a focus off the middle of the plate": {"camera.focus_mm": 0.5},
    "a load that is uneven through the thickness": {"load.tilt": 0.15},
    "a load that swings within the exposure": {"load.swing": 0.1},
    "the pixel's size": {"camera.pixel_mm": 1.003},
    "the fringe value": {"specimen.fringe_value_n_per_mm": 1.03},
    "what the scene states with an uncertainty": {"specimen.fringe_value_n_per_mm": 14.746},
    "tractions that are not the model's": {
        "load.added_tractions": {
            "x_mm": [-0.2, -0.1, 0.0, 0.1, 0.2], "pressure_mpa": [0.0, 1.5, -1.5, 1.5, 0.0],
            "shear_mpa": [0.0, 0.0, 0.0, 0.0, 0.0],
        }
    },
    "more uneven light": "12 % brighter in a spot of 0.5 mm",
    "a shadow on the surface": "30 % darker at the surface, over 4 pixels",
    "an order that no cause explains": "0.05 fringe in a hill of 0.7 mm",
    "a stress that no cause explains": "0.3 MPa across the corner in a hill of 0.7 mm",
}  # fmt: skip
"""What each page's bench has: keys of the scene (of a ring's scale its share), or words."""

RINGS = ("the pixel's size", "the fringe value")


def base(name):
    """The scene that the frame is fitted with, without the fact."""
    if name in RINGS:
        return load_scene("ring")
    contact = tomllib.loads(dump_scene(load_scene("line-contact-wear")))
    contact["friction"]["static_state_first"] = False
    contact["camera"] |= {"width_px": 330, "height_px": 247, "pixel_mm": 4.0 / 330}
    if name == "another friction before":
        contact["wear"]["distances_m"] = [155.0]
    else:
        del contact["wear"]
    return load_scene(contact)


def hill(x, z, x_mm, z_mm, width_mm):
    return np.exp(-0.5 * ((x - x_mm) ** 2 + (z - z_mm) ** 2) / width_mm**2)


def rendered(name, scene):
    """The grey levels (rows, cols) and the orders of the frame with the fact."""
    fact = FACTS[name]
    if name in RINGS:
        scene = scene.with_values({key: scene.get(key) * share for key, share in fact.items()})
    elif isinstance(fact, dict):
        scene = scene.with_values(fact)
    grid = pixel_grid(scene)
    renderer = SceneRenderer(scene, (grid.rows, grid.cols))
    field = renderer.difference(scene, renderer.state(scene))
    x, z = (np.asarray(places) for places in (grid.x_mm[None, :], grid.z_mm[:, None]))
    per_mpa = scene.specimen.thickness_mm / scene.specimen.fringe_value_n_per_mm
    if name == "an order that no cause explains":
        field = field * (1.0 + 0.05 * hill(x, z, 0.8, 1.0, 0.7) / (per_mpa * np.abs(field) + 0.05))
    if name == "a stress that no cause explains":
        field = field + 0.3j * hill(x, z, 0.8, 1.0, 0.7)
    picture = make_picture(scene, field, grid, renderer.moments(scene))
    signal = np.where(picture.material, picture_signal(scene, picture), 0.0)
    if scene.camera.blur_px:
        signal = blurred(signal, scene.camera.blur_px)
    light = DARK + LIGHT * signal * (1.0 - 0.1 * (x**2 / x.max() ** 2 + (z / z.max()) ** 2))
    if name == "more uneven light":
        light = light * (1.0 + 0.12 * hill(x, z, -0.9, 1.5, 0.25))
    if name == "a shadow on the surface":
        light = light * (1.0 - 0.3 * np.exp(-z / (4.0 * grid.pixel_mm)))
    gamma = scene.frames.first_gamma
    light = 255.0 * (light / 255.0) ** (1.0 / gamma)
    noise = NOISE * np.random.default_rng(list(FACTS).index(name)).normal(size=light.shape)
    return np.clip(np.rint(light + noise), 0, 255).astype(np.uint8), picture.order


def measured(name):
    """The fit without the fact: residual over noise, the order's difference, and the numbers."""
    scene = base(name)
    image, order = rendered(name, scene)
    data = prepare_frame(Frame(0, image, None, "atlas"), scene, bit_depth=BITS)
    fit = fit_frame(data, scene)
    data = data.as_fitted(fit.scene)
    model = evaluate_model(data, fit.scene)
    light = model.background + model.illumination * model.signal(1)
    residual = np.where(model.mask, (data.light - light) / data.sigma, np.nan)
    apart = np.where(model.mask, order - model.picture.order, np.nan)
    most = np.sort(np.abs(apart[np.isfinite(apart)]))
    most = most[: round(0.99 * most.size)]
    numbers = {"chi": fit.chi, "order": float(np.sqrt(np.mean(most**2)))}
    for key in ("load.normal_n", "friction.coefficient"):
        if key in fit.keys:
            numbers[key] = float(fit.values[fit.keys.index(key)]), float(scene.get(key))
    return residual, apart, numbers


def palette():
    """The colours of the differences, and greys: rare ones are not merged."""
    colours = colormaps[figures.DIFFERENCE_MAP](np.linspace(0.0, 1.0, COLOURS))[:, :3]
    greys = np.linspace(0.0, 1.0, GREYS)[:, None] * np.ones(3)
    result = Image.new("P", (1, 1))
    result.putpalette(bytes(np.rint(255.0 * np.concatenate([colours, greys])).astype(np.uint8)))
    return result


def draw(path, residual, apart):
    """Both pictures side by side: the residual's means over 3 x 3 pixels, over their noise."""
    rows, cols = (n // MEAN for n in residual.shape)
    squares = residual[: MEAN * rows, : MEAN * cols].reshape(rows, MEAN, cols, MEAN)
    residual = MEAN * squares.mean(axis=(1, 3))
    figure = figures.new_figure(5.6, 2.3)
    figure.set_layout_engine("none")
    limit = float(np.nanpercentile(np.abs(apart), 99.0))
    limit = float(f"{max(limit, 0.002):.1g}")
    shown = ("residual over noise", residual, 5.0), ("order: bench − fit, fringes", apart, limit)
    for k, (title, values, most) in enumerate(shown):
        axes = figure.add_axes((0.01 + 0.5 * k, 0.13, 0.48, 0.78))
        axes.imshow(values, cmap=figures.DIFFERENCE_MAP, vmin=-most, vmax=most, aspect="equal")
        axes.set_title(title, fontsize=8)
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_xlabel(f"−{most:g} (blue) to {most:g} (red)", fontsize=7)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=100)
    with Image.open(file) as picture:
        few = picture.convert("RGB").quantize(palette=palette(), dither=Image.Dither.NONE)
    path.parent.mkdir(exist_ok=True)
    few.save(path, optimize=True)


HEAD = """# Atlas of residuals

What a frame leaves when it is fitted as its scene states it, by what the bench has and the scene
does not. Left: residual over noise. Right: the order of the bench less the fitted one. Names are
those of the messages; `looks_like` in frames.csv, and the report, name the nearest pages of a frame
with the share of its residual that each alone explains, to first order. Sizes: one frame of the
paper's contact (44 N on 4 mm, friction 0.25, 12 µm a pixel, noise 3 of 190 grey levels; of another
friction before a worn one, of two pages a ring) fitted without the fact, the order by the 99 % of
the pixels that differ least. Blur, plates, band, tilt and swing enter by their square; the others
in proportion.

In short: focus to ± 0.1 mm; tilt below 10 % of the load at the faces; roll below 0.1 degree; light
from no-load frames; the edge annealed; modulus and fringe value from the same plate.
"""


def entry(name, words, numbers):
    """A page's text."""
    fact = FACTS[name]
    if name in RINGS:
        ((key, share),) = fact.items()
        size = f"`{key}` {100.0 * (share - 1.0):+.2g} % (a ring)"
    elif name == "tractions that are not the model's":
        size = "± 1.5 MPa in waves of 0.2 mm"
    elif isinstance(fact, dict):
        size = ", ".join(f"`{key} = {value:g}`" for key, value in fact.items())
    else:
        size = fact
    parts = [f"{numbers['order']:.2g} fringe RMS", f"chi {numbers['chi']:.2f}"]
    if "load.normal_n" in numbers:
        value, true = numbers["load.normal_n"]
        parts.insert(1, f"load {100.0 * (value / true - 1.0):+.2g} %")
    if "friction.coefficient" in numbers:
        value, true = numbers["friction.coefficient"]
        parts.insert(2, f"friction {value - true:+.2g}")
    keys = KEYS.get(name, ())
    key_line = f"**Keys.** {', '.join(f'`{key}`' for key in keys)}\n" if keys else ""
    return (
        f"\n## {name}\n\n![{name}]({atlas_file(name)})\n\n"
        f"**Looks like.** {words['looks']}\n**Usual causes.** {words['usual']}\n"
        f"**Size.** {size}: {', '.join(parts)}.\n{key_line}**Remedy.** {words['remedy']}\n"
    )


def main():
    words = tomllib.loads(WORDS.read_text("utf-8"))
    text = HEAD
    for name in sys.argv[1:] or words:
        residual, apart, numbers = measured(name)
        draw(GUIDE / atlas_file(name), residual, apart)
        print(name, numbers, (GUIDE / atlas_file(name)).stat().st_size, flush=True)
        text += entry(name, words[name], numbers)
    if not sys.argv[1:]:
        (GUIDE / "atlas.md").write_text(text, "utf-8")


if __name__ == "__main__":
    main()
