"""The cases of woven cloth, as continuous integration runs them, and what they are made of."""

import numpy as np
import pytest

from engine.validate import catalogue, woven_drape, woven_energy, woven_pull_out, woven_shear


@pytest.mark.parametrize("id", ["woven-picture-frame", "woven-pull-out", "woven-energy", "woven-biaxial", "woven-drape"])
def test_case_is_at_its_bar(id):
    [entry] = catalogue.run([id], quick=True)["cases"]
    assert entry["status"] == "pass", entry["note"]
    assert len(entry["rows"]) >= 2


def test_the_frame_goes_far_behind_the_angle_of_jamming():
    of_angle = [woven_shear.law(np.radians(angle)) for angle in woven_shear.ANGLES]
    assert of_angle[-1] < 4.0 * of_angle[3]
    assert woven_shear.law(np.pi / 2) == 0.0


def test_the_pull_out_ends_with_no_force_and_begins_with_all():
    passed, force = woven_pull_out.pulled(0.05)
    unit = woven_pull_out.FRICTION * woven_pull_out.normal_force()
    assert force[passed < 0.5][-1] == pytest.approx(woven_pull_out.CROSSINGS * unit, rel=0.02)
    assert abs(force[-1]) < 1e-3 * unit


def test_the_layers_in_flight_slide_over_each_other_and_friction_takes_energy():
    left = [woven_energy.rise(mu, 2e-3, "flat")[1] for mu in woven_energy.FRICTION]
    assert left[1] < left[0] - 0.05


def test_the_draped_corner_hangs_and_its_clamp_holds():
    model, state = woven_drape.cloth(2)
    held = ~model.free_directions.any(axis=(1, 2))
    rows = np.round(state.x[held, 0] / woven_drape.ROW + woven_drape.EDGE, 6)
    assert held.any() and rows.max() == woven_drape.CLAMP
    [rest, later] = woven_drape.corner(1, woven_drape.LONG, [woven_drape.SETTLED, 1.5 * woven_drape.SETTLED])
    assert -rest[2] > 0.4 * woven_drape.HANGING
    assert np.linalg.norm(later - rest) < 1e-3 * woven_drape.HANGING, "it has come to rest"
