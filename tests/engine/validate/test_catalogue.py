import json
from xml.etree import ElementTree

import pytest

from engine.validate import catalogue
from engine.validate.catalogue import CaseResult, Row, UnknownCase, case, run
from engine.validate.fit import fitted_exponent
from engine.validate.page import validation_page
from engine.validate.plot import Series, loglog


@pytest.fixture
def registry(monkeypatch):
    """An empty catalogue, which the modules of the real one do not fill."""
    monkeypatch.setattr(catalogue, "_cases", {})
    monkeypatch.setattr(catalogue.pkgutil, "iter_modules", lambda path: [])


def rows(order: float = 2.0) -> list[Row]:
    return [Row("dt [s]", dt, 3 * dt**order, 1e-3 / dt) for dt in (1e-3, 2e-3, 4e-3)]


def only_entry(result: dict) -> dict:
    return result["cases"][0]


def test_a_case_at_its_bar_passes(registry):
    case("a", bar=1e-5, order=1.8, summary="s")(lambda quick: CaseResult(rows(), 1e-5, order=2.0))
    entry = only_entry(run())
    assert entry["status"] == "pass" and entry["rows"][1] == {
        "knob": "dt [s]", "value": 2e-3, "error": 3 * 2e-3**2, "seconds": 0.5}


@pytest.mark.parametrize("result, said", [
    (CaseResult([], 2e-5), "above the bar"),
    (CaseResult([], float("nan")), "above the bar"),
    (CaseResult([], 0.0, order=1.7), "order 1.7 is below 1.8"),
    (CaseResult([], 0.0), "order None is below 1.8"),
    (CaseResult([], 0.0, order=2.0, failures=["slips at 40 deg"]), "slips at 40 deg"),
])
def test_a_case_off_its_bar_fails_with_its_number(registry, result, said):
    case("a", bar=1e-5, order=1.8, summary="s")(lambda quick: result)
    entry = only_entry(run())
    assert entry["status"] == "fail" and said in entry["note"]
    json.dumps(entry, allow_nan=False)


def test_a_case_that_raises_fails_and_the_rest_goes_on(registry):
    @case("broken", bar=1.0, summary="s")
    def broken(quick):
        raise ZeroDivisionError("no mass")

    case("sound", bar=1.0, summary="s")(lambda quick: CaseResult([], 0.5))
    told = []
    result = run(on_progress=lambda *progress: told.append(progress))
    assert [entry["status"] for entry in result["cases"]] == ["fail", "pass"]
    assert only_entry(result)["note"] == "ZeroDivisionError: no mass"
    assert told == [(0, 2, "broken"), (1, 2, "sound"), (2, 2, "")]
    assert not catalogue.passed(result)


def test_quick_reaches_the_case_and_ids_choose(registry):
    seen = []
    for name in ("a", "b"):
        case(name, bar=1.0, summary="s")(lambda quick, name=name: seen.append((name, quick)) or CaseResult([], 0.0))
    assert catalogue.passed(run(["b"], quick=True))
    assert seen == [("b", True)]


def test_an_unknown_id_names_the_known_ones(registry):
    case("eol-peg", bar=1.0, summary="s")(lambda quick: CaseResult([], 0.0))
    with pytest.raises(UnknownCase, match=r"eol-pog.*eol-peg"):
        run(["eol-pog"])


def test_an_id_is_taken_once(registry):
    case("a", bar=1.0, summary="s")(lambda quick: CaseResult([], 0.0))
    with pytest.raises(ValueError, match="two cases"):
        case("a", bar=1.0, summary="s")(lambda quick: CaseResult([], 0.0))


def test_cases_of_the_package_are_found():
    assert all(entry.id == id and entry.bar >= 0 and entry.summary for id, entry in catalogue.cases().items())


def test_fitted_exponents():
    dt = [0.1, 0.05, 0.025]
    assert fitted_exponent(dt, [7 * h**1.5 for h in dt]) == pytest.approx(1.5)
    assert fitted_exponent(dt, [1.0, 0.0, float("nan")]) is None
    assert fitted_exponent([1.0, 1.0], [1.0, 2.0]) is None


def test_the_page_shows_every_case_and_is_self_contained(registry):
    case("good", bar=1.0, order=1.8, summary="falls <fast>")(lambda quick: CaseResult(rows(), 1e-5, 2.0, "fine"))
    case("exact", bar=1.0, summary="s")(lambda quick: CaseResult([Row("n", 3, 0.0, 0.1)], 0.0))
    page = validation_page(run())
    assert "falls &lt;fast&gt;" in page and "✓ pass" in page and "Nothing to plot" in page
    assert "http" not in page and "<script" not in page and "1 of 2" not in page


def test_a_plot_is_wellformed_and_places_points_logarithmically():
    x, y = [1.0, 10.0, 100.0], [1e-2, 1e-4, 1e-6]
    svg = ElementTree.fromstring(loglog("t & u", "x", "y", [Series("a", x, y, ["p<0", "p1", "p2"])], bar=1e-5))
    circles = [node for node in svg.iter() if node.tag == "circle"]
    across = [float(circle.get("cx")) for circle in circles]
    up = [float(circle.get("cy")) for circle in circles]
    assert across[1] - across[0] == pytest.approx(across[2] - across[1], abs=0.11) and across[0] < across[1]
    assert up[1] - up[0] == pytest.approx(up[2] - up[1], abs=0.11) and up[0] < up[1]
    assert [node.text for node in svg.iter() if node.tag == "title"] == ["p<0", "p1", "p2"]


def test_a_long_legend_has_several_lines_and_further_series_hollow_markers():
    series = [Series(f"a name of some length {k}", [1.0, 2.0], [1.0, 2.0], ["p", "q"]) for k in range(6)]
    few, many = (ElementTree.fromstring(loglog("t", "x", "y", shown)) for shown in (series[:2], series))
    height = [float(svg.get("viewBox").split()[3]) for svg in (few, many)]
    assert height[1] > height[0]
    names = [node for node in many.iter() if (node.text or "").startswith("a name")]
    assert len(names) == 6 and all(float(node.get("x")) + 6 * len(node.text) < 560 for node in names)
    assert sum(node.get("fill") == "var(--card)" for node in many.iter()) == 2 * (6 - 4)
