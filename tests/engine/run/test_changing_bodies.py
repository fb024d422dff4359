"""Strands on a body that changes its shape, in the time loop: rooted ones go with it, loose ones are lifted by it."""

import numpy as np
import pytest
import trimesh

from engine.contact.obstacles import posed
from engine.geometry.solids import distance_to
from engine.run.frames import frame_paths, read_frame
from engine.run.simulation import run
from engine.scene.build import build
from engine.scene.load import load_scene
from tests.engine.run.outputs import assert_goes_on, stop_after, whole_run

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.02)
RADIUS, SWOLLEN = 2e-4, 1.1
TOP = [[round(0.0015 * k, 4), 0.0, round(0.0203 - 0.05 * (0.0015 * k) ** 2 / 0.002, 6)] for k in range(-4, 5)]
SWELLING = {
    "strandline": 1, "name": "a ball that swells", "duration": 0.05, "fps": 100, "step": {"default": 1e-3},
    "materials": {"nylon": {"radius": RADIUS, "volume_density": 1150.0, "youngs_modulus": 1e7, "mass_damping": 20.0}},
    "strands": [
        {"name": "fur", "material": "nylon", "vertices": 5,
         "groom": {"on": "ball", "facing": [1, 0, 0], "within": 40, "count": 6, "length": 0.01}},
        {"name": "loose", "material": "nylon", "curves": [TOP]},
    ],
    "obstacles": [{
        "name": "ball", "shape": "mesh", "vertices": BALL.vertices.tolist(), "faces": BALL.faces.tolist(), "friction": 0.8,
        "handle": "lift", "shapes": [{"time": 0.05, "vertices": (SWOLLEN * BALL.vertices).tolist()}],
    }],
    "script": {"handles": [{"name": "lift", "keyframes": [{"time": 0}, {"time": 0.05, "offset": [0, 0, 0.001]}]}]},
    "output": {"checkpoint_every": 1},
}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    return whole_run(load_scene(SWELLING), tmp_path_factory.mktemp("unbroken"))


def test_roots_are_on_their_triangles_in_every_frame(unbroken):
    made = build(load_scene(SWELLING))
    (held,) = made.strand_roots
    for path in frame_paths(unbroken[2]):
        frame = read_frame(path)
        places, _ = held.at(made.obstacles, made.handles, frame.time)
        np.testing.assert_allclose(frame.strands.positions[held.vertex], places, atol=1e-8)
    away = frame.strands.positions[made.strands.start[:6]] - [0.0, 0.0, 0.001]
    np.testing.assert_allclose(away, SWOLLEN * made.strand_state.x[made.strands.start[:6]], atol=1e-8)


def test_what_lies_on_it_is_lifted(unbroken):
    """By the swelling and by the handle, no deeper in it than contact forces are found to."""
    made, frame, outward = build(load_scene(SWELLING)), read_frame(frame_paths(unbroken[2])[-1]), np.empty(3)
    solids = posed(made.obstacles, made.handles, frame.time)
    loose = frame.strands.positions[frame.strands.offsets[6] :].astype(float)
    distance = np.array([distance_to(solids, 0, place, outward) for place in loose])
    assert distance.min() > 0.9 * RADIUS
    rise = loose[4, 2] - TOP[4][2]
    assert rise == pytest.approx((SWOLLEN - 1.0) * 0.02 + 0.001, abs=RADIUS)
    assert unbroken[0]["error"]["contact_gap_max"] < 0.1 and unbroken[0]["counts"]["contacts_max"] > 0


def test_it_goes_on_as_if_it_had_not_stopped(unbroken, tmp_path):
    assert run(load_scene(SWELLING), tmp_path, threads=1, should_stop=stop_after(23))["state"] == "cancelled"
    assert_goes_on(load_scene(SWELLING), tmp_path, unbroken)
