"""The benchmark of speed against error: a row for every pair of knobs, errors that fall with the step."""

from engine.bench.front import of_scene
from engine.yarns.settings import YarnSettings


def test_errors_fall_with_the_step_and_the_fastest_and_the_best_are_on_the_front():
    rows = list(of_scene("friction-incline", (4.0, 1.0), (YarnSettings.tolerance,), (0.25, 1e-4), simulated=8))
    assert [row.size for row in rows] == [2, 8] and {row.unit for row in rows} == {"steps"}
    coarse, fine = rows
    assert fine.error < coarse.error < 0.1
    assert fine.standing.default and not coarse.standing.default
    assert fine.standing.on_front
