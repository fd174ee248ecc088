"""The texts among the sample images: what a user would have written beside their own frames."""

from __future__ import annotations

CONTACT_FRAMES = """
[frames]
no_load_dark = "no-load-dark.tif"       # unloaded specimen, dark field
no_load_bright = "no-load-bright.tif"   # unloaded specimen, bright field
gamma = 1.4                       # this camera stores light^(1/1.4)
"""

BENDING_SET = """\
# Four-point bending of an epoxy beam, dark field, sodium light; one image a load.

[beam]
thickness_mm = 6.0
height_mm = 20.0
inner_span_mm = 40.0
outer_span_mm = 100.0

[camera]
pixel_mm = 0.05
bit_depth = 8
gamma = 1.4                       # this camera stores light^(1/1.4)

[[image]]
file = "bending-060N.png"
load_n = 60.0

[[image]]
file = "bending-100N.png"
load_n = 100.0

[[image]]
file = "bending-150N.png"
load_n = 150.0

[[image]]
file = "bending-200N.png"
load_n = 200.0

[uncertainty]                     # standard uncertainties of what was measured beside the images
load_percent = 0.3
height_mm = 0.02
span_mm = 0.05
pixel_mm = 0.00005
"""

DISC_SET = """\
# A disc of the same epoxy under diametral load, dark field, sodium light; one image a load.

[disc]
diameter_mm = 50.0
thickness_mm = 6.0

[camera]
bit_depth = 8
gamma = 1.4                       # this camera stores light^(1/1.4)

[[image]]
file = "disc-350N.png"
load_n = 350.0

[[image]]
file = "disc-560N.png"
load_n = 560.0

[[image]]
file = "disc-800N.png"
load_n = 800.0

[uncertainty]                     # standard uncertainties of what was measured beside the images
load_percent = 0.3
diameter_mm = 0.02
"""

DISC_SCENE = """\
# The same disc as a scene, at the load of disc-560N.png; change normal_n for another image.

[specimen]
shape = "disc"
diameter_mm = 50.0
thickness_mm = 6.0
fringe_value_n_per_mm = 14.6      # per fringe

[load]
normal_n = 560.0

[polariscope]
wavelength_nm = 587.0
field = "dark"

[camera]                          # without left_mm and top_mm: the disc in the middle, nearly so
width_px = 420
height_px = 420
pixel_mm = 0.13
bit_depth = 8

[frames]
gamma = 1.4                       # this camera stores light^(1/1.4)
"""

README = """\
# Sample images

**Every image here is rendered by Isochrome. None was captured by a camera.** They are made as poor
as a real camera's, and the values that were put in lie beside them, so that a result can be judged.
All of it comes from one command, and the same seed gives the same files:

    python -m isochrome.samples sample_images --seed @SEED@

The camera is the same in all of them: 8 bits, stored as light^(1/1.4), noise of 3 grey levels
(standard deviation), light that falls off by 30 % to the corners, stray light of 5 % of full scale,
a blur of 0.4 pixels, and some dead (0) and hot (255) pixels. A pixel is the mean over its
area, from 3 x 3 points in it. The `truth.json` files hold what was put in, also the places of the
faulty pixels, by the keys of the scene file where it has them; angles are in degrees, rows and
columns count from 0.

## line-contact-wear

The six states of the paper's wear test: static, first sliding, and after 31, 77, 155 and 233 m.

| file | what it is |
|---|---|
| `line-contact-wear/scene.toml` | the scene as the laboratory knows it: nominal values |
| `line-contact-wear/captured.tif` | the six frames, 659 x 494 pixels |
| `line-contact-wear/no-load-dark.tif` | the unloaded specimen in the dark field, mean of \
16 frames |
| `line-contact-wear/no-load-bright.tif` | the same in the bright field |
| `line-contact-wear/true_fringe_order.tif` | the fringe order at the pixels' centres, 32-bit \
float, rounded to 2^-13 fringe; NaN above the surface |
| `line-contact-wear/truth.json` | the values that were put in |

What the scene does not know, and `truth.json` says: the load is 1.5 % above nominal, the wear
coefficient 3 %; friction is 0.236 at first and rises to 0.252 (nominal 0.25); the contact lies
about 4.5 pixels left of and 2.5 pixels below its nominal place, and drifts by half a pixel through
the frames. The cylinder is opaque, so that the top rows are dark but for stray light. Twenty pixels
are dead or hot, and a lamp's reflection saturates a spot of some fifty pixels, in all frames alike.

## bending

Four-point bending of a beam between its inner rollers, 480 x 440 pixels, dark field.

| file | what it is |
|---|---|
| `bending/set.toml` | the calibration set |
| `bending/bending-060N.png` | the beam at 60 N |
| `bending/bending-100N.png` | the beam at 100 N |
| `bending/bending-150N.png` | the beam at 150 N |
| `bending/bending-200N.png` | the beam at 200 N |
| `bending/truth.json` | the values that were put in |

The beam is tilted by 1.3 degrees, and an order of 0.05 at its edges is there without load. The
loads and the sizes in the set are exact, although the set states uncertainties for them as a
laboratory would.

## disc

A disc under diametral load, 420 x 420 pixels, dark field, a few pixels off the picture's middle.

| file | what it is |
|---|---|
| `disc/set.toml` | the calibration set |
| `disc/scene.toml` | the disc as a scene, for `isochrome process disc/disc-560N.png` |
| `disc/disc-350N.png` | the disc at 350 N |
| `disc/disc-560N.png` | the disc at 560 N |
| `disc/disc-800N.png` | the disc at 800 N |
| `disc/truth.json` | the values that were put in |

The loads and the sizes in the set are exact here too, and there is no order at zero load.
"""
