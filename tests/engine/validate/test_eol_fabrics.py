"""The cases of fabrics and crossing rods, as continuous integration runs them, and what they are made of."""

from itertools import pairwise

import numpy as np
import pytest

from engine.run.adaptivity import StepTooSmall
from engine.validate import catalogue, eol_cross, eol_degenerate, eol_fabrics, eol_separate
from engine.validate.eol_march import March
from engine.yarns.model import PointKind

AT_THEIR_BAR = ("eol-incline", "eol-cross", "eol-degenerate", "eol-degenerate-denim", "eol-separate", "yarn-recontact")


@pytest.mark.parametrize("id", AT_THEIR_BAR)
def test_case_is_at_its_bar(id):
    [entry] = catalogue.run([id], quick=True)["cases"]
    assert entry["status"] == "pass", entry["note"]
    assert len(entry["rows"]) >= 3


def test_the_measure_of_acceleration_tells_coefficients_apart():
    time, speed = eol_fabrics.slide(0.5, eol_fabrics.STEEP, 0.0, 2e-3)
    gain = np.polyfit(time, speed, 1)[0]
    at_half, at_one = (eol_fabrics.EARTH * (np.sin(np.pi / 3) - mu * np.cos(np.pi / 3)) for mu in (0.5, 1.0))
    assert abs(gain - at_half) < 0.1 * abs(gain - at_one)


def test_on_the_diagonal_two_independent_laws_hold_what_slides_by_coulombs():
    steep = 50.0
    speed = {law: eol_fabrics.slide(1.0, steep, eol_fabrics.DIAGONAL, 2e-3, law)[1] for law in ("isotropic", "box")}
    assert speed["isotropic"][-1] - speed["isotropic"][len(speed["isotropic"]) // 2] > 1e-2
    assert abs(speed["box"][-1]) < 1e-4


def test_without_eil_nodes_rods_do_not_pass():
    run = eol_cross.draw(np.random.default_rng(3), 1e-3)
    over, strayed = eol_cross.excess(run)
    assert over <= eol_cross.BAR and strayed <= eol_cross.FOLLOWS
    assert eol_cross.excess(run, eil=False)[0] > eol_cross.BAR


def test_stacks_are_full_of_eil_points_and_some_are_coincident():
    stacks = [eol_degenerate.stack(cloth, seed, layers) for cloth in (eol_degenerate.COTTON, eol_degenerate.DENIM)
              for seed in range(3) for layers in eol_degenerate.LAYERS]
    assert all(share >= eol_degenerate.SHARE for _, share in stacks)
    assert any(eol_degenerate.has_coincident_nodes(march) for march, _ in stacks)


def test_a_layer_that_is_not_turned_over_keeps_its_contacts():
    march = March(eol_separate.layers(1e-3, eol_separate.OFFSETS[0]))
    march.pull(eol_separate.DOWN, separation_time=0.0, separation_force=0.0)
    march.reach(0.01)
    assert march.state.active[march.model.point_kind == PointKind.CONTACT].all()


def test_only_a_scene_that_asks_for_the_sign_of_forces_pays_for_it():
    iterations, least = {}, {}
    for force in (0.0, 1.0):
        march = March(eol_separate.layers(2e-3, eol_separate.OFFSETS[0]))
        march.reach(eol_separate.SETTLED)
        contacts = march.model.point_kind == PointKind.CONTACT
        for share in (0.75, 0.5, 0.25, 0.02):
            march.pull(share * eol_separate.DOWN, separation_time=1.0, separation_force=force)
            [attempt] = march.attempts(march.time + 2e-3)
            iterations[force] = iterations.get(force, 0) + attempt.report.newton_iterations
        least[force] = march.state.normal_force[contacts].min()
    assert least[0.0] > 0.0 > least[1.0]
    assert iterations[1.0] < iterations[0.0]


def test_march_halves_steps_and_gives_up_as_a_run_does():
    run = eol_cross.draw(np.random.default_rng(3), 1e-3)
    march = March(eol_cross.scene(run, eil=False))
    eol_cross.set_in_motion(march, run)
    tried = []
    with pytest.raises(StepTooSmall):
        for attempt in march.attempts(run.duration):
            tried.append(attempt)
    rejected = [attempt for attempt in tried if not attempt.report.accepted]
    assert len(rejected) > 5 and rejected[-1].h < rejected[0].h / 30
    assert all(later.time >= earlier.time for earlier, later in pairwise(tried))
