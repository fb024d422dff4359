"""What is read off a state of strands, against closed forms and sums over vertices written out."""

import numpy as np
import pytest

from engine.strands import observe
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.validate.der_gradients import Chart, random_strand

NYLON = StrandMaterial(density=1150.0, young=2e9, shear=0.75e9)
GRAVITY = np.array([0.0, 0.0, -9.81])


def straight(*counts: int):
    """Straight strands of length 0.1 m side by side, in groups of their own, with so many vertices."""
    assembly = StrandAssembly()
    for k, n in enumerate(counts):
        points = np.column_stack([np.linspace(0.0, 0.1, n), np.full(n, 0.01 * k), np.zeros(n)])
        assembly.strand(points, np.array([2e-4, 0.5e-4]), NYLON, group=k)
    return assembly.build()


def test_a_strand_that_flies_and_spins():
    model, state = straight(11)
    state.velocity[:] = speed = np.array([1.0, -2.0, 3.0])
    state.spin[:-1] = 40.0
    mass = NYLON.density * np.pi * 1e-8 * 0.1
    about_itself = mass * (2e-4**2 + 0.5e-4**2) / 4.0
    np.testing.assert_allclose(observe.momentum(model, state), mass * speed)
    energies = observe.energies(model, state, GRAVITY)
    assert energies["kinetic"] == pytest.approx(0.5 * mass * speed @ speed + 0.5 * about_itself * 1600.0, rel=1e-12)
    assert energies["potential"] == pytest.approx(0.0, abs=1e-18)
    state.x[:, 2] += 0.5
    assert observe.energies(model, state, GRAVITY)["potential"] == pytest.approx(mass * 9.81 * 0.5)


def test_elastic_energy_is_that_of_the_steps():
    """Of several strands it is the sum over each alone, whatever their lengths."""
    alone = [random_strand(seed) for seed in range(3)]
    for model, state in alone:
        massless = model._replace(**{name: 0 * getattr(model, name) for name in ("mass", "spin_inertia", "damping")})
        chart = Chart(massless, state, 1.0)
        energy = observe.elastic_energy(model, state.x, state.m1, state.twist)
        assert energy == pytest.approx(chart.energy(np.zeros(chart.unknowns)), rel=1e-10)
    model, state = straight(3, 9, 2, 40)
    state.x[:, 2] = 0.3 * np.sin(200 * state.x[:, 0])
    total = 0.0
    for a, b in zip(model.start[:-1], model.start[1:], strict=True):
        own = {name: values[a:b] for name, values in model._asdict().items() if len(values) == len(state.x)}
        one = model._replace(start=np.array([0, b - a]), **own)
        total += observe.elastic_energy(one, state.x[a:b], state.m1[a:b], state.twist[a:b])
    assert observe.elastic_energy(model, state.x, state.m1, state.twist) == pytest.approx(total, rel=1e-12)


def test_strain_is_the_mean_of_both_edges_and_at_ends_that_of_one():
    model, state = straight(4, 3)
    state.x[2:4, 0] += 0.1 * 0.1 / 3  # the second edge is a tenth longer
    state.x[4:] *= 0.8
    np.testing.assert_allclose(observe.strain(model, state)[:4], [0.0, 0.05, 0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(observe.strain(model, state)[4:], -0.2)


@pytest.mark.parametrize("radius", [0.02, 0.5])
def test_curvature_is_one_over_the_radius(radius):
    model, state = straight(41, 3, 2)
    angle = state.x[:41, 0] / radius
    state.x[:41] = radius * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    found = observe.curvature(model, state)
    np.testing.assert_allclose(found[:41], 1.0 / radius, rtol=1e-3)
    np.testing.assert_allclose(found[41:], 0.0, atol=1e-9)


def test_a_fold_has_the_largest_curvature_there_is():
    model, state = straight(5)
    state.x[3:] = state.x[[1, 0]]
    found = observe.curvature(model, state)
    np.testing.assert_allclose(found, [0.0, 0.0, np.pi / 0.025, 0.0, 0.0], atol=1e-9)


def test_ends_have_the_curvature_beside_them():
    model, state = straight(3)
    state.x[2, :2] = state.x[1, 0], 0.05
    np.testing.assert_allclose(observe.curvature(model, state), 0.5 * np.pi / 0.05)


def test_frames_hold_every_vertex():
    model, state = straight(4, 7)
    state.vertex_contact_force = np.arange(11) * 1e-3
    frame = observe.strand_frame_arrays(model, state)
    np.testing.assert_array_equal(frame["positions"], state.x.astype(np.float32))
    np.testing.assert_array_equal(frame["offsets"], [0, 4, 11])
    np.testing.assert_array_equal(frame["group"], [0, 1])
    np.testing.assert_allclose(frame["radius"], 1e-4, rtol=1e-6)  # of the round section of the same area
    np.testing.assert_array_equal(frame["contact_force"], state.vertex_contact_force.astype(np.float32))
    for name in ("positions", "radius", "strain", "curvature", "contact_force"):
        assert frame[name].dtype == np.float32 and len(frame[name]) == 11 and np.isfinite(frame[name]).all()
