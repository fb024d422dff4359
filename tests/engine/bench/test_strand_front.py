"""The benchmark of speed against error of strands at sizes that say nothing about speed: errors that fall, the peer beside."""

import numpy as np
import pytest

from engine.bench import hair_flip, peer_rod, rod_problems, strand_front, suite
from engine.bench.suite import Note
from engine.strands.settings import StrandSettings
from tests.engine.bench.peers import without


@pytest.fixture
def alone(monkeypatch):
    """A machine without the peer."""
    without(monkeypatch, "elastica")


def test_more_segments_bring_the_tip_of_the_cantilever_nearer_to_the_elastica(alone):
    coarse, fine = strand_front.of_rod(rod_problems.let_go(), (8, 16), (20,), (0.9,))
    assert 3.0 < coarse.error / fine.error < 5.0  # second order
    assert (coarse.size, coarse.unit, coarse.details) == (20, "steps", {"segments": 8})
    assert fine.standing.on_front and not fine.standing.default
    assert coarse.peer is None and coarse.peer_seconds is None


def test_smaller_steps_bring_the_swing_nearer_to_that_of_a_beam(alone):
    coarse, fine = strand_front.of_rod(rod_problems.first_mode(), (32,), (50, 100), (0.9,))
    assert 1.6 < coarse.error / fine.error < 2.2  # first order


def test_without_the_peer_a_note_says_so(alone):
    note = next(strand_front.strand_front())
    assert isinstance(note, Note) and "PyElastica" in note.text


def test_the_peer_swings_the_same_rod():
    pytest.importorskip("elastica")
    own, peers = strand_front.of_rod(rod_problems.first_mode(), (16,), (100,), (0.9,))
    assert own.peer == "PyElastica" and own.peer_seconds == peers.seconds
    assert peers.error < 0.01 and peers.peer is None  # a bar that no other rod or clamp would pass
    assert peers.size == peer_rod.stable_steps(rod_problems.first_mode(), 16, 0.9)


def test_the_peers_steps_are_shorter_where_segments_are():
    problem = rod_problems.first_mode()
    counts = [peer_rod.stable_steps(problem, segments, 1.0) for segments in (4, 1000, 2000)]
    assert counts[1] > counts[0] and counts[2] / counts[1] == pytest.approx(2.0, rel=0.01)
    assert peer_rod.stable_steps(problem, 4, 0.5) == pytest.approx(2 * counts[0], abs=1)


def test_thickness_slows_the_first_mode_as_it_does_with_the_shape_under_an_even_load():
    s = np.linspace(0.0, 1.0, 1001)
    shape, slope, integral = s**4 - 4 * s**3 + 6 * s**2, 4 * s**3 - 12 * s**2 + 12 * s, s**5 / 5 - s**4 + 2 * s**3
    shear = rod_problems.ROOTS[0] ** 2 * (integral[-1] - integral)  # of the inertia of that shape
    wanted = rod_problems.SLENDERNESS * np.trapezoid(slope**2, s) + rod_problems.SHEARED * np.trapezoid(shear**2, s)
    assert rod_problems.thickness_effect() == pytest.approx(wanted / np.trapezoid(shape**2, s), rel=0.03)


def test_more_segments_bring_the_capstan_nearer_to_its_law():
    coarse, fine = strand_front.of_capstan((8, 16), (4,))
    assert fine.error < 0.5 * coarse.error and coarse.size == 4


def test_the_flip_of_hair_has_a_row_for_every_choice():
    default = StrandSettings.contact_tolerance
    rows = list(strand_front.of_hair(hair_flip.thinned(2), 4e-3, (15,), (2.0, 1.0), (default,), (30, 0.5, default)))
    assert [row.size for row in rows] == [2, 4] and {row.unit for row in rows} == {"steps"}
    assert [row.standing.default for row in rows] == [False, True]
    assert all(0.0 < row.error < 0.1 for row in rows)


def test_hairs_are_compared_where_both_have_vertices():
    few = np.zeros((2, 4, 3))
    few[:, :, 0] = np.linspace(0.0, 0.3, 4)
    many = np.zeros((2, 7, 3))
    many[:, :, 0] = np.linspace(0.0, 0.3, 7)
    many[:, 1::2, 1] = 5.0  # which the others do not have
    assert hair_flip.distance(few, many) == hair_flip.distance(many, few) == pytest.approx(0.0, abs=1e-15)
    many[:, ::2, 2] = 0.03
    assert hair_flip.distance(many[:, ::2], few) == pytest.approx(0.1)


def test_it_is_in_the_suite():
    assert "strand-front" in suite.benchmarks()
