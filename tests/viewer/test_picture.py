"""Still pictures, drawn by the Chromium that is installed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from engine.run.frames import Frame, write_frame
from tests.viewer import liquids, strands, synthetic
from viewer import layers
from viewer.picture import CannotDraw, View, _eye, _towards, draw
from viewer.stage import Shown

ALL = Shown(lines=True, nodes=False, obstacles=True, paint="fabric")


def test_a_frame_is_drawn_at_the_size_asked_for(tmp_path):
    synthetic.write_job(tmp_path / "cloths", 2)
    path = tmp_path / "picture.png"
    assert draw(tmp_path / "cloths", -1, ALL, View(), (240, 160), path) == "shown all 350 segments"
    drawn = np.asarray(Image.open(path).convert("RGB"), float)
    assert drawn.shape == (160, 240, 3)
    green = (drawn[..., 1] > 1.2 * drawn[..., 0]) & (drawn[..., 1] > 1.1 * drawn[..., 2])
    assert green.mean() > 0.01, "the lower fabric"
    assert (np.ptp(drawn, axis=2) < 24).mean() > 0.2, "obstacles and background are grey"


@pytest.mark.parametrize(("paint", "said"), [
    (None, "shown all 1,152 segments"),
    ("force", "shown all 1,152 segments; contact force from 0 (grey) to 20 µN (dark red)"),
])
def test_strands_are_drawn_in_colours_that_are_said(tmp_path, paint, said):
    strands.write_job(tmp_path / "tufts", 6)
    path = tmp_path / "picture.png"
    assert draw(tmp_path / "tufts", -1, replace(ALL, paint=paint), View(), (240, 160), path) == said
    drawn = np.asarray(Image.open(path).convert("RGB"), float)
    red = (drawn[..., 0] > 1.25 * drawn[..., 1]) & (drawn[..., 0] > 1.25 * drawn[..., 2])
    blue = drawn[..., 2] > 1.25 * drawn[..., 0]
    assert red.mean() > 0.002, "brown strands, or those that press"
    assert (blue.mean() > 0.002) == (paint is None), "blue strands"


@pytest.mark.parametrize(("shown", "said"), [
    ({"paint": None}, r"shown the surface, [\d,]+ triangles"),
    ({"paint": None, "surface": False}, "shown all 6,401 particles"),
    ({"paint": "yielded"}, r"shown all 6,401 particles; yielded \(orange\) or not \(grey\)"),
])
def test_liquid_is_drawn_as_surface_or_particles(tmp_path, shown, said):
    liquids.write_job(tmp_path / "basin", 4, surfaced=True)
    path = tmp_path / "picture.png"
    assert re.fullmatch(said, draw(tmp_path / "basin", -1, replace(ALL, **shown), View(), (240, 160), path))
    drawn = np.asarray(Image.open(path).convert("RGB"), float)
    blue = drawn[..., 2] > 1.25 * drawn[..., 0]
    orange = drawn[..., 0] > 1.5 * drawn[..., 2]
    assert (orange if shown["paint"] else blue).mean() > 0.05 and (blue if shown["paint"] else orange).mean() < 0.005


def test_a_few_hairs_are_seen(tmp_path):
    """Hairs of a tenth of a millimetre that hang straight, in a picture whose pixels are larger."""
    strands.write_job(tmp_path / "hairs", 0)
    thin = strands.curled(2, 16)
    thin.positions[:] = [[x, 0.0, -0.02 * i] for x in (0.0, 0.1) for i in range(16)]
    write_frame(tmp_path / "hairs", Frame(0, 0.0, 0, strands=thin))
    path = tmp_path / "picture.png"
    draw(tmp_path / "hairs", 0, replace(ALL, paint=None, obstacles=False), View(), (600, 400), path)
    drawn = np.asarray(Image.open(path).convert("RGB"), float)
    darker = drawn.max(axis=2) < 0.97 * drawn.max()
    assert darker.any(axis=1).sum() > 0.7 * len(drawn), "from top to bottom"


def test_colours_cannot_say_what_a_scene_does_not_have(tmp_path):
    strands.write_job(tmp_path / "tufts", 1)
    with pytest.raises(CannotDraw, match="group, strain, curvature or force, not fabric"):
        draw(tmp_path / "tufts", 0, ALL, View(), (240, 160), tmp_path / "picture.png")


def test_a_frame_that_is_not_there_is_an_error(tmp_path):
    synthetic.write_job(tmp_path / "cloths", 2)
    with pytest.raises(CannotDraw, match="2 frames, none with number 2"):
        draw(tmp_path / "cloths", 2, ALL, View(), (240, 160), tmp_path / "picture.png")


def test_without_chromium_there_is_no_picture(tmp_path, monkeypatch):
    synthetic.write_job(tmp_path / "cloths", 1)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CannotDraw, match="Chromium"):
        draw(tmp_path / "cloths", 0, ALL, View(), (240, 160), tmp_path / "picture.png")


@pytest.mark.parametrize(("azimuth", "elevation"), [(-46, 27), (0, 0), (200, 90), (90, -30)])
def test_the_box_just_fits_into_the_picture(azimuth, elevation):
    low, high, aspect = np.array((-1.0, 0, 2)), np.array((3.0, 1, 2.5)), 1.5
    eye, target = _eye(low, high, View(azimuth, elevation), aspect)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    axes = Rotation.from_quat(_towards(target - eye), scalar_first=True).as_matrix().T
    x, y, depth = axes @ (corners - eye).T
    filled = np.maximum(np.abs(x) / aspect, np.abs(y)) / depth / np.tan(layers.FIELD_OF_VIEW / 2)
    assert (depth > 0).all() and 0.85 < filled.max() < 1
