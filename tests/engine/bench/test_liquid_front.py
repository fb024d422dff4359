"""The benchmark of liquids' speed against error at sizes that say nothing about speed: errors that fall, the front beside."""

import numpy as np

from engine.bench import liquid_front, suite
from engine.bench.suite import Note
from engine.validate.liquid_film import LIQUIDS


def test_more_cells_bring_a_film_nearer_to_its_profile():
    coarse, fine = liquid_front.of_film("Newtonian", LIQUIDS["Newtonian"], (4, 8), (5e-4,))
    assert fine.error < 0.5 * coarse.error < 0.05
    assert (coarse.size, coarse.unit, coarse.details) == (2000.0, "steps", {"cells": 4})
    assert fine.standing.on_front


def test_more_cells_bring_a_front_nearer_to_the_finest(monkeypatch):
    monkeypatch.setattr(liquid_front, "MEASURED", liquid_front.MEASURED[:6])
    coarse, fine, note = liquid_front.of_dam((2, 4), (0.8,), (8, 0.8))
    assert fine.error < 0.5 * coarse.error < 0.5
    assert isinstance(note, Note) and "Martin and Moyce" in note.text


def test_what_was_measured_is_slower_than_ritters_front():
    assert "+0.0 to +0.0 %" in liquid_front.comparison(liquid_front.MEASURED[:, 1])
    time, place = liquid_front.MEASURED.T
    assert np.all(np.diff(place) > 0.0) and np.all(np.diff(place)[4:] / np.diff(time)[4:] < 2.0)


def test_it_is_in_the_suite():
    assert "liquid-front" in suite.benchmarks()
