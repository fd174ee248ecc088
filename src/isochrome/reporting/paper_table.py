"""What a paper states of a measurement: camera, light, specimen, software, input."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any, Protocol

from isochrome.output import with_uncertainty
from isochrome.scene import Camera, Frames, Polariscope, Scene

_MEASURED = (
    ("pixel", "camera.pixel_mm", "mm"),
    ("fringe value f_sigma", "specimen.fringe_value_n_per_mm", "N/mm per fringe"),
    ("thickness", "specimen.thickness_mm", "mm"),
    ("Young's modulus", "specimen.young_gpa", "GPa"),
    ("Poisson's ratio", "specimen.poisson", ""),
    ("diameter", "specimen.diameter_mm", "mm"),
    ("indenter's radius", "indenter.radius_mm", "mm"),
)
"""Names, keys and units of the measured numbers that a paper states."""

_MOST_FILES = 16
"""Of the input, with their hashes: a run may be of thousands of single pictures."""

NO_DATE = (
    "not stated in the scene, where calibrate --into writes it; else it stands in the report of "
    "the calibration"
)


class WithCamera(Protocol):
    """A scene, or a calibration's set: what stood in front of the camera."""

    @property
    def camera(self) -> Camera | None:
        """The camera."""

    @property
    def polariscope(self) -> Polariscope:
        """The light."""

    @property
    def frames(self) -> Frames:
        """How its frames are read."""


def camera_rows(found: WithCamera) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of the camera and the light."""
    return [*_camera(found), *_light(found)]


def paper_rows(scene: Scene | None, record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values, with units, of what a paper states of a run.

    `record` is provenance.json: versions and hashes; the scene is None where the run has none.
    """
    own = [] if scene is None else [*camera_rows(scene), *_numbers(scene)]
    return [*own, *_software(record), *_input(record)]


def _camera(scene: WithCamera) -> Iterator[tuple[str, str]]:
    camera = scene.camera
    if camera is None:
        return
    parts = []
    if camera.width_px and camera.height_px:
        parts.append(f"{camera.width_px} x {camera.height_px} pixels")
    if camera.bit_depth:
        parts.append(f"{camera.bit_depth} bit")
    parts += ["colour"] if camera.colour else []
    parts.append(f"gamma {scene.frames.gamma}")
    yield "camera", ", ".join(parts)


def _light(scene: WithCamera) -> Iterator[tuple[str, str]]:
    light = scene.polariscope
    field = f"{len(light.step)} phase steps" if light.step else f"{light.field} field"
    if light.several_wavelengths:
        yield "light", f"several wavelengths, {field}"
    elif light.wavelength_nm is None:
        yield "light", f"wavelength not stated, {field}"
    else:
        band = f", band {light.bandwidth_nm:g} nm" if light.bandwidth_nm else ""
        yield "light", f"{light.wavelength_nm:g} nm{band}, {field}"


def _numbers(scene: Scene) -> Iterator[tuple[str, str]]:
    stated = dict(scene.stated_uncertainty)
    for name, key, unit in _MEASURED:
        part = getattr(scene, key.partition(".")[0])
        value = None if part is None else getattr(part, key.partition(".")[2], None)
        if value is None:
            continue
        spread = stated.get(key)
        text = f"{value:g}" if spread is None else with_uncertainty(value, spread)
        own = "no uncertainty stated" if spread is None else "standard uncertainty"
        yield name, f"{text} {unit}".strip() + f" ({own})"
        if name.startswith("fringe value"):
            yield "date of f_sigma", scene.fringe_value_date or NO_DATE


def _software(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    libraries = record.get("libraries") or {}
    versions = ", ".join(f"{name} {number}" for name, number in libraries.items())
    code = record.get("code_sha256")
    yield "software", f"isochrome {record.get('isochrome', 'not known')}"
    if versions:
        yield "with", versions
    if code:
        yield "SHA-256 of the code", str(code)


def _input(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    files = list((record.get("inputs_sha256") or {}).items())
    for name, digest in files[:_MOST_FILES]:
        yield f"SHA-256 of {PurePath(*PurePath(name).parts[-2:])}", str(digest)
    if len(files) > _MOST_FILES:
        yield f"SHA-256 of {len(files) - _MOST_FILES} files more", "in provenance.json"
