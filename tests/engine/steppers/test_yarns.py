"""Steps of yarns: free fall, momentum, constraints, rejection, determinism."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from engine.contact.obstacles import ObstacleKind, Obstacles
from engine.geometry.handles import Handles, no_handles
from engine.steppers.yarns import YarnStepper
from engine.yarns import observe
from engine.yarns.assembly import YarnAssembly
from engine.yarns.model import PointKind
from engine.yarns.settings import YarnSettings
from tests.engine.yarns.stacks import GRAVITY, MATERIAL, NO_OBSTACLES, UP, free_weaves, perturbed, random_stack, straight_yarn

EXACT = YarnSettings(tolerance=1e-12, linear_tolerance=1e-12)
H = 0.01


def steps(stepper, state, count, h=H):
    """Take `count` steps, all of which must be accepted; returns the reports."""
    reports = [stepper.step(state, n * h, h) for n in range(count)]
    assert all(report.accepted for report in reports), [report.reason for report in reports]
    return reports


def alone(model, settings=EXACT, gravity=GRAVITY, obstacles=NO_OBSTACLES, handles=None):
    return YarnStepper(model, settings, gravity, obstacles, handles or no_handles())


def held_rod():
    """A rod that hangs from a handle, slides through an eyelet and over an edge, and rests on a given yarn."""
    yarns = YarnAssembly()
    rod, given = yarns.yarn(MATERIAL, 3.0, 0.5), yarns.yarn(MATERIAL, 1.0, 0.5, kinematic=True)
    yarns.lagrangian(rod, 0.0, np.zeros(3), pinned=True, handle=0)
    yarns.eyelet(rod, 0.5, np.array([0.5, 0.0, 0.0]), friction=0.1)
    yarns.edge(rod, 1.0, np.array([1.0, 0.0, 0.0]), np.array([0.6, 0.8, 0.0]), friction=0.1)
    yarns.crossing(given, 0.5, rod, 1.5, np.array([1.5, 0.0, 0.0]), UP, 0.1, PointKind.CONTACT)
    for u in (2.0, 2.5, 3.0):
        yarns.lagrangian(rod, u, np.array([u, 0.0, 0.0]))
    for u in (0.0, 1.0):
        yarns.lagrangian(given, u, np.array([1.5, u - 0.5, 0.0]), pinned=True)
    handles = Handles(np.array([0, 2]), np.array([0.0, 0.1]), np.array([[0.0, 0, 0], [0.02, 0.0, 0.01]]))
    return *yarns.build(), handles


def roof(up):
    """A taut rod over a given yarn, its ends half as low as they are away; with the contact and the force there."""
    yarns, half = YarnAssembly(), np.sqrt(1.25)
    length, material = 2.0 * half / 1.05, replace(MATERIAL, bending_stiffness=0.0)
    bar, rod = yarns.yarn(material, 2.0, 1.0, kinematic=True), yarns.yarn(material, length, length / 2.0)
    point = yarns.crossing(bar, 1.0, rod, length / 2.0, np.zeros(3), up, 0.3, PointKind.CONTACT)
    for end in (0, 1):
        yarns.lagrangian(bar, 2.0 * end, np.array([2.0 * end - 1.0, 0.0, 0.0]), pinned=True)
        yarns.lagrangian(rod, end * length, np.array([0.0, 2.0 * end - 1.0, -0.5]), pinned=True)
    force = 2.0 * 0.05 * material.stretch_stiffness * 0.5 / half + 0.5 * material.density * length
    return *yarns.build(), point, force


def test_free_fall_is_that_of_implicit_euler_to_round_off():
    """x_n = x_0 + n h v_0 + h^2 g n (n + 1) / 2, whatever the yarn's stiffness."""
    model, state = straight_yarn([0.0, 0.5, 1.5, 2.0], mass_damping=0.0)
    start, speed = state.x.copy(), np.array([0.5, -1.0, 2.0])
    state.velocity[:] = speed
    count = 10
    steps(alone(model), state, count)
    wanted = start + count * H * speed + H**2 * GRAVITY * count * (count + 1) / 2.0
    np.testing.assert_allclose(state.x, wanted, rtol=0.0, atol=1e-14)
    moves = state.velocity[[0, 1, 1, 2, 2, 3], [1, 0, 1, 0, 1, 0]]
    np.testing.assert_allclose(moves, np.broadcast_to(speed + count * H * GRAVITY, moves.shape), rtol=1e-11)


def test_momentum_changes_by_weight_only():
    """Through contacts that slide, switch and rub, to the tolerance of Newton."""
    h, count, switched = 0.05, 10, False
    for seed in range(3):
        stack = free_weaves(seed, mass_damping=0.0)
        model, state = stack.model, stack.state
        before, eil, mass = observe.momentum(model, state), state.eil.copy(), np.sum(model.density * model.length)
        stepper = alone(model, replace(EXACT, tolerance=1e-9))
        for n in range(count):
            steps(stepper, state, 1, h)
            switched |= (state.eil != eil).any()
            wanted = before + (n + 1) * h * mass * GRAVITY
            np.testing.assert_allclose(observe.momentum(model, state), wanted, atol=1e-8 * mass)
        assert np.abs(state.u_rate).max() > 1e-3
    assert switched


def test_constrained_points_stay_where_they_are_held():
    model, state, handles = held_rod()
    start = state.copy()
    stepper = alone(model, YarnSettings(), handles=handles)
    for n in range(10):
        assert stepper.step(state, n * H, H).accepted
        moved = state.x - start.x
        pinned = (model.free_directions == 0.0).all(axis=(1, 2))
        carried = model.handle == 0
        np.testing.assert_array_equal(moved[pinned & ~carried], 0.0)
        np.testing.assert_allclose(moved[carried], handles.offsets((n + 1) * H), atol=1e-15)
        edge = moved[model.point_kind == PointKind.EDGE]
        np.testing.assert_allclose(np.cross(edge, [0.6, 0.8, 0.0]), 0.0, atol=1e-14)
        np.testing.assert_array_equal(state.u[model.u_fixed], start.u[model.u_fixed])
    assert np.abs(edge).max() > 1e-5 and np.abs(state.u - start.u).max() > 1e-5


def test_a_turning_handle_carries_what_it_holds_around_its_pivot():
    model, state, handles = held_rod()
    pivot = np.array([[0.0, 0.0, -0.1]])
    turning = replace(handles, angles=np.array([[0.0, 0.0, 0.0], [0.0, 30.0, 0.0]]), pivot=pivot)
    steps(alone(model, YarnSettings(), handles=turning), state, 5)
    half_way = np.radians(15.0)
    arm, offset = 0.1 * np.array([np.sin(half_way), 0.0, np.cos(half_way)]), [0.01, 0.0, 0.005]
    np.testing.assert_allclose(state.x[model.handle == 0], pivot + arm + offset, atol=1e-15)


def test_a_rejected_step_leaves_no_trace():
    model, state, handles = held_rod()
    steps(alone(model, YarnSettings(), handles=handles), state, 3)
    before = state.copy()
    report = alone(model, replace(EXACT, max_newton=1), handles=handles).step(state, 3 * H, H)
    assert not report.accepted and report.reason
    for name, values in vars(before).items():
        assert getattr(state, name).tobytes() == values.tobytes(), name


def rods_about_to_meet():
    """A rod and two across it, at rest as their rates of u say, whose velocities have them pass each other in a step."""
    yarns, along, across = YarnAssembly(), np.linspace(0.0, 1.0, 9), np.linspace(0.0, 0.5, 5)
    rod = yarns.yarn(MATERIAL, 1.0, 0.125)
    speed = {rod: 0.0}
    yarns.lagrangians(rod, along, np.column_stack([along, 0.0 * along, 0.0 * along]))
    for place, towards in ((0.52, 4.0), (0.58, -4.0)):
        slider = yarns.yarn(MATERIAL, 0.5, 0.125)
        speed[slider] = towards
        yarns.lagrangians(slider, across, np.column_stack([0.0 * across + place, across - 0.27, 0.0 * across]))
        yarns.crossing(rod, place, slider, 0.27, np.array([place, 0.0, 0.0]), UP)
    model, state = yarns.build()
    state.velocity[..., 0] += np.array([speed[yarn] for yarn in model.node_yarn])[:, None]
    return model, state


def test_nodes_that_turn_out_to_meet_pass_each_other_in_the_same_step(monkeypatch):
    model, state = rods_about_to_meet()
    report = steps(alone(model, YarnSettings(), 0.0 * GRAVITY), state, 1)[0]
    shared = model.point_nodes[model.node_point, 1] >= 0
    first, second = np.flatnonzero((model.node_yarn == 0) & shared)
    assert state.u[first] > state.u[second]
    assert state.eil[first] != state.eil[second]
    assert report.contact_gap <= YarnSettings.gap_tolerance and report.residual <= YarnSettings.tolerance

    monkeypatch.setattr("engine.steppers.yarns.MEETING", 0.0)
    model, state = rods_about_to_meet()
    assert not alone(model, YarnSettings(), 0.0 * GRAVITY).step(state, 0.0, H).accepted


@pytest.mark.parametrize("name", ["x", "u_rate", "velocity"])
def test_a_state_that_is_not_finite_is_rejected(name):
    model, state, handles = held_rod()
    free = model.point_nodes[model.point_kind == PointKind.CONTACT, 1][0]
    getattr(state, name)[model.node_point[free] if name == "x" else free] = np.nan
    report = alone(model, YarnSettings(), handles=handles).step(state, 0.0, H)
    assert not report.accepted and report.reason


def test_two_runs_are_the_same_to_the_bit():
    ends = []
    for _ in range(2):
        stack = free_weaves(0)
        reports = steps(alone(stack.model, YarnSettings(), GRAVITY), stack.state, 5)
        ends.append((stack.state, [(r.newton_iterations, r.linear_iterations, r.residual) for r in reports]))
    (one, reports), (other, same_reports) = ends
    assert reports == same_reports
    for name, values in vars(one).items():
        assert values.tobytes() == getattr(other, name).tobytes(), name


def test_a_report_tells_what_happened():
    stack = free_weaves(0)
    settings = YarnSettings(tolerance=1e-4, separation_time=1.0)
    report = steps(alone(stack.model, settings, GRAVITY), stack.state, 1)[0]
    assert report.residual <= settings.tolerance and report.contact_gap <= settings.gap_tolerance
    assert report.newton_iterations >= 1 and report.linear_iterations >= 1
    assert report.penetration == 0.0 and report.removed == 0 and report.reason == ""
    assert {"assign", "assemble", "factor", "solve", "line_search", "commit"} <= set(report.stages)


def test_a_yarn_comes_to_rest_on_a_floor():
    """The floor carries the weight: the penalty forces of all points add up to it."""
    model, state = straight_yarn([0.0, 0.5, 1.0, 1.5, 2.0], mass_damping=5.0)
    state.x[:, 2] = MATERIAL.radius
    floor = Obstacles(np.array([ObstacleKind.PLANE], np.int64), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)),
                      np.array([0.5]))
    stepper = alone(model, replace(EXACT, tolerance=1e-9, obstacle_factor=10.0), -UP, floor)
    report = steps(stepper, state, 100, h=0.1)[-1]
    assert np.sum(state.obstacle_force) == pytest.approx(MATERIAL.density * 2.0, rel=1e-4)
    assert report.penetration == 0.0 and (state.x[:, 2] < MATERIAL.radius).all()


def test_a_moving_floor_drags_a_rod_along():
    """It slides with mu g until it is as fast as the floor, and then goes along."""
    friction, speed, weight, h = 0.5, 1.0, 1.0, 0.05
    model, state = straight_yarn([0.0, 0.5, 1.0, 1.5, 2.0], mass_damping=0.0)
    depth = MATERIAL.density * 0.5 * weight / (100.0 * MATERIAL.stretch_stiffness / 0.5)
    state.x[:, 2] = MATERIAL.radius - depth * np.array([0.5, 1.0, 1.0, 1.0, 0.5])
    floor = Obstacles(np.array([ObstacleKind.PLANE], np.int64), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)),
                      np.array([friction]), np.array([0]))
    handles = Handles(np.array([0, 2]), np.array([0.0, 10.0]), np.array([[0.0, 0, 0], [10.0 * speed, 0, 0]]))
    stepper = alone(model, replace(EXACT, tolerance=1e-9, obstacle_factor=100.0), -weight * UP, floor, handles)
    speeds = []
    for n in range(60):
        assert stepper.step(state, n * h, h).accepted
        speeds.append(observe.momentum(model, state)[0] / (MATERIAL.density * 2.0))
    time = h * np.arange(1, 61)
    sliding = time < 0.9 * speed / (friction * weight)
    # the first step knows no normal force yet, and feels no friction
    np.testing.assert_allclose(np.diff(speeds)[sliding[1:]], friction * weight * h, rtol=0.02)
    np.testing.assert_allclose(np.array(speeds)[time > 1.2 * speed / (friction * weight)], speed, rtol=0.02)


def test_a_rod_presses_with_its_tension_and_half_its_weight():
    """2 T sin(angle) + m g / 2: the given yarn has no equation of its own, the rod's carries the whole load."""
    model, state, point, force = roof(UP)
    steps(alone(model, replace(EXACT, tolerance=1e-9, constraint_factor=1e4), -UP), state, 20, h=0.1)
    assert state.normal_force[point] == pytest.approx(force, rel=1e-3)
    assert state.active[point] and state.pulling_time[point] == 0.0


def test_a_rod_that_pulls_is_let_go():
    model, state, point, _ = roof(-UP)
    held = YarnSettings(separation_time=3 * H, separation_force=0.5, constraint_factor=1e4)
    reports = steps(alone(model, held, -UP), state, 4)
    assert [report.removed for report in reports] == [0, 0, 1, 0]
    assert not state.active[point]


def test_forces_are_doubted_for_as_long_as_updates_of_multipliers_tell_more():
    """Contacts whose multipliers and gaps cancel may pull or press as well; a second look at the same gaps tells no more."""
    stack = random_stack(0)
    x, u = perturbed(stack, 0)
    potential = stack.potential()
    potential.gradient(x, u)
    potential.multiplier[potential.split] = -potential.resistance()
    stepper = alone(stack.model, YarnSettings(separation_force=0.0))
    lacked = np.full(len(x), np.inf)
    doubtful = stepper.in_doubt(potential, x, u, 1.0, lacked)
    assert doubtful.any() and (stack.model.point_kind[doubtful] == PointKind.CONTACT).all()
    assert (lacked[doubtful] > 0.0).all()
    assert not stepper.in_doubt(potential, x, u, 1.0, lacked.copy()).any()
    np.testing.assert_array_equal(stepper.in_doubt(potential, x, u, 1.0, 2.0 * lacked), doubtful)
    potential.multiplier[potential.split] *= -9.0  # presses or pulls by ten times what its gap makes
    assert not stepper.in_doubt(potential, x, u, 1.0, np.full(len(x), np.inf)).any()


def test_a_step_without_obstacles_asks_nothing_of_them():
    stack = free_weaves(0)
    assert len(stack.potential().touching) == 0
    steps(alone(stack.model, YarnSettings(), GRAVITY), stack.state, 2)
    assert not stack.state.obstacle_force.any()


def test_yarns_need_no_other_physics():
    """A scene of rods leaves the modules of strands, shells and liquid unloaded."""
    code = """
import sys
import engine.steppers.yarns
loaded = {name.split(".")[1] for name in sys.modules if name.startswith("engine.")}
assert not loaded & {"strands", "shells", "liquid", "film", "coupling", "scene", "run", "validate", "bench"}, loaded
"""
    subprocess.run([sys.executable, "-c", code], check=True)
