"""Nozzles let out speed times area times time, in layers that depend on the time alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry.handles import Handles, no_handles
from engine.liquid.sources import LiquidSources, emitted

PLACE = np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 0.1, 1.0]])
SPEED, THICKNESS, BEGIN, VOLUME = 0.5, 0.02, 0.1, 1e-4
DOWN = np.array([0.0, 0.0, -1.0])


def nozzle(jitter=0.0, layers=np.inf, handle=-1):
    one = np.ones(1)
    return LiquidSources(
        place=(PLACE,), volume=VOLUME * one, jitter=jitter * one, flow=DOWN[None], speed=SPEED * one,
        thickness=THICKNESS * one, begin=BEGIN * one, layers=layers * one, handle=np.array([handle]), seed=3)


def poured(sources, steps, handles=None):
    """All that came out in steps of the given sizes, moved on evenly to the end, and how many layers."""
    layers, time, x, volume = np.zeros(1, np.int64), 0.0, np.zeros((0, 3)), 0.0
    for h in steps:
        out = emitted(sources, layers, handles or no_handles(), time, h)
        x = np.concatenate([x + h * SPEED * DOWN, out.x])
        volume += out.volume.sum()
        layers, time = out.layers, time + h
    return x, volume, layers[0]


@given(st.lists(st.floats(1e-3, 0.3), min_size=1, max_size=8))
def test_layers_are_those_of_the_column_whatever_the_steps(steps):
    x, volume, layers = poured(nozzle(), steps)
    column = SPEED * max(sum(steps) - BEGIN, 0.0)
    assert layers in (np.floor(column / THICKNESS - 1e-6), np.floor(column / THICKNESS + 1e-6))
    assert volume == pytest.approx(layers * len(PLACE) * VOLUME)
    middle = column - (np.arange(layers) + 0.5) * THICKNESS  # how far each layer has come
    np.testing.assert_allclose(x, (PLACE + middle[:, None, None] * DOWN).reshape(-1, 3), atol=1e-12)


def test_a_layer_is_out_exactly_when_it_has_passed():
    for k in range(1, 30):
        assert poured(nozzle(), [BEGIN + k * THICKNESS / SPEED])[2] == k


def test_a_nozzle_that_ceases_lets_out_no_more():
    x, volume, layers = poured(nozzle(layers=4.0), [0.3] * 5)
    assert layers == 4 and len(x) == 12 and volume == pytest.approx(12 * VOLUME)
    assert emitted(nozzle(layers=4.0), np.array([4]), no_handles(), 9.0, 1.0).x.shape == (0, 3)


def test_jitter_is_the_same_whatever_the_steps_and_no_larger_than_said():
    straight, once, often = (poured(nozzle(jitter), steps)[0]
                             for jitter, steps in ((0.0, [1.0]), (0.004, [1.0]), (0.004, [0.125] * 8)))
    np.testing.assert_allclose(once, often, atol=1e-12)
    off = np.abs(once - straight)
    assert 0.003 < off.max() <= 0.004 and not np.allclose(once[:3] - straight[:3], once[3:6] - straight[3:6])


@settings(max_examples=20)
@given(st.floats(0.01, 0.5))
def test_a_carried_nozzle_adds_its_velocity(h):
    moving = Handles(np.array([0, 2]), np.array([0.0, 2.0]), np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))  # 1 m/s along x
    out = emitted(nozzle(handle=0), np.zeros(1, np.int64), moving, BEGIN, h)
    np.testing.assert_allclose(out.velocity, np.broadcast_to([1.0, 0.0, -SPEED], out.x.shape), atol=1e-9)
    # all that came out hangs straight below the nozzle, which moves as it does
    np.testing.assert_allclose(out.x[:, 0], np.tile(PLACE[:, 0], len(out.x) // 3) + BEGIN + h, atol=1e-9)


def test_a_turned_nozzle_pours_where_it_points():
    turned = Handles(np.array([0, 1]), np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    tilted = Handles(np.array([0, 2]), np.array([0.0, 0.05]), np.zeros((2, 3)), np.array([[0.0, 0, 0], [0, -90.0, 0]]),
                     np.array([[0.0, 0.0, 1.0]]))
    for handles, flow in ((turned, [0, 0, -1.0]), (tilted, [1.0, 0, 0])):
        out = emitted(nozzle(handle=0), np.zeros(1, np.int64), handles, 0.4, 0.1)
        np.testing.assert_allclose(out.velocity, SPEED * np.tile(flow, (len(out.x), 1)), atol=1e-12)
