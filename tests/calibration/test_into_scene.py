"""A fringe value set in a scene file: all else in it stays, whatever its layout."""

import dataclasses
import tomllib

import pytest

from isochrome.calibration import Calibration, saved, write_into_scene
from isochrome.errors import InputError
from isochrome.scene import load_scene, with_value

FOUND = Calibration(
    specimen="disc", fringe_value_n_per_mm=14.61234, standard_uncertainty=0.0131, chi=1.02,
    order_at_zero_load=0.0, order_at_zero_load_uncertainty=0.001, slope_per_n=0.005,
    images=(), budget=(), warnings=(),
)  # fmt: skip
LAYOUTS = {
    "table": "[specimen]\nthickness_mm = 4.0\nfringe_value_n_per_mm = 12.0\n\n[load]\n"
    "normal_n = 44.0\n",
    "comment": "# mine\n[specimen]  # block\nfringe_value_n_per_mm = 12.0e0      # per fringe\n"
    "thickness_mm = 4.0\n",
    "no key": "[load]\nnormal_n = 44.0\n\n[specimen]\n# the block\nthickness_mm = 4.0\n",
    "header at the end": "[load]\nnormal_n = 44.0\n[specimen]",
    "inline": 'specimen = { thickness_mm = 4.0, "fringe_value_n_per_mm" = 12.0 } # epoxy\n',
    "inline, no key": "specimen = { thickness_mm = 4.0 }\n[load]\nnormal_n = 1.0\n",
    "inline, empty": "specimen = {}\n",
    "dotted": "specimen.thickness_mm = 4.0\nspecimen . fringe_value_n_per_mm = 12\n",
    "dotted, no key": "specimen.thickness_mm = 4.0\nload.normal_n = 44.0\n",
    "quoted": "[ 'specimen' ]\n\t'fringe_value_n_per_mm'=12.0#per fringe\n",
    "named in comments": "# [specimen]\n# fringe_value_n_per_mm = 12.0\n[specimen]\n"
    "thickness_mm = 4.0 # not fringe_value_n_per_mm = 3\n",
    "stated before": "[specimen]\nfringe_value_n_per_mm = { value = 12.0, "
    "standard_uncertainty = 0.5 }  # per fringe\n",
    "no specimen": "[load]\nnormal_n = 44.0",
    "empty": "",
}


def edited(text, value, spread, comment):
    """A scene's text with another fringe value."""
    written = f"{{ value = {value}, standard_uncertainty = {spread} }}"
    key = "specimen.fringe_value_n_per_mm"
    return with_value(text, key, written, comment=comment, mark=saved.MARK)


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_only_the_value_changes(name, line_end):
    text = LAYOUTS[name].replace("\n", line_end)
    new = edited(text, "14.612", "0.013", "calibrated: chi 1.02")
    data = tomllib.loads(text)
    known = {"value": 14.612, "standard_uncertainty": 0.013}
    data.setdefault("specimen", {})["fringe_value_n_per_mm"] = known
    assert tomllib.loads(new) == data
    assert new.count("calibrated: chi 1.02") == 1
    kept = [part.strip() for part in text.splitlines() if "12" not in part and "{" not in part]
    assert all(part in new for part in kept)
    assert new.count("\r\n") == (new.count("\n") if "\r\n" in text else 0)
    for comment in ("per fringe", "epoxy", "block", "mine"):
        assert new.count(comment) == text.count(comment)
    again = edited(new, "14.700", "0.020", "calibrated: chi 1.10")
    wanted = new.replace("14.612", "14.700").replace("0.013", "0.020").replace("1.02", "1.10")
    assert again == wanted


def test_a_second_calibration_replaces_its_own_comment_and_keeps_the_users(tmp_path):
    """What stood behind ours was lost with it."""
    path = tmp_path / "scene.toml"
    path.write_text("[specimen]\nfringe_value_n_per_mm = 12.0  # epoxy\n", "utf-8")
    write_into_scene(FOUND, path, source="one;two.toml")
    text = path.read_text("utf-8")
    assert text.endswith("# epoxy; calibrated: chi 1.02, onetwo.toml\n")
    path.write_text(text.replace("two.toml", "two.toml; by Max"), "utf-8")
    write_into_scene(dataclasses.replace(FOUND, chi=1.5), path, source="disc.toml")
    assert path.read_text("utf-8").endswith("# epoxy; by Max; calibrated: chi 1.50, disc.toml\n")


def test_a_byte_order_mark_stays(tmp_path):
    """It was refused as no TOML, in a file that every other command reads."""
    path = tmp_path / "scene.toml"
    path.write_text("\ufeff[specimen]\nfringe_value_n_per_mm = 12.0\n", "utf-8")
    assert write_into_scene(FOUND, path) == load_scene(path).specimen.fringe_value_n_per_mm
    assert path.read_bytes().startswith(b"\xef\xbb\xbf[specimen]")


def test_a_file_is_written_with_its_value_rounded_to_its_uncertainty(tmp_path, monkeypatch):
    monkeypatch.setattr(saved, "calibration_day", lambda: "2026-11-25")
    path = tmp_path / "scene.toml"
    path.write_bytes(b"[specimen]\r\nfringe_value_n_per_mm = 12.0 # per fringe\r\n")
    assert write_into_scene(FOUND, path, source="sets/disc.toml") == 14.6123
    text = path.read_bytes().decode("utf-8")
    said = "# per fringe; calibrated: chi 1.02, disc.toml"
    value = '{ value = 14.6123, standard_uncertainty = 0.0131, date = "2026-11-25" }'
    assert text == (f"[specimen]\r\nfringe_value_n_per_mm = {value} {said}\r\n")
    scene = load_scene(path)
    assert scene.specimen.fringe_value_n_per_mm == 14.6123
    assert scene.uncertainties == {"specimen.fringe_value_n_per_mm": 0.0131}
    assert scene.fringe_value_date == "2026-11-25"
    assert [p.name for p in tmp_path.iterdir()] == ["scene.toml"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "own.toml").write_text("[specimen]\n", "utf-8")
    (tmp_path / "scene.toml").symlink_to("own.toml")
    write_into_scene(FOUND, tmp_path / "scene.toml")
    assert (tmp_path / "scene.toml").is_symlink()
    assert "14.6123" in (tmp_path / "own.toml").read_text("utf-8")


def test_what_is_no_scene_of_ones_own_is_refused(tmp_path):
    with pytest.raises(InputError, match="ships inside the package"):
        write_into_scene(FOUND, "line-contact-wear")
    with pytest.raises(InputError, match="cannot be read"):
        write_into_scene(FOUND, tmp_path / "missing.toml")
    other = tmp_path / "set.toml"
    text = "[disc]\ndiameter_mm = 50.0\n"
    other.write_text(text, "utf-8")
    with pytest.raises(InputError, match="disc"):
        write_into_scene(FOUND, other)
    assert other.read_text("utf-8") == text


def test_a_name_cannot_break_the_comment(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("[specimen]\n", "utf-8")
    write_into_scene(FOUND, path, source="odd\nname.toml")
    assert load_scene(path).specimen.fringe_value_n_per_mm == 14.6123
    exact = dataclasses.replace(FOUND, standard_uncertainty=0.0)
    assert write_into_scene(exact, path) == 14.61234
