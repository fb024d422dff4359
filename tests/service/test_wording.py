"""How figures are told: three digits, and the unit that a rounded figure has."""

import pytest

from service.wording import duration


@pytest.mark.parametrize(("seconds", "told"), [
    (None, "–"), (0.0, "0 s"), (2.5e-4, "250 µs"), (9.99e-4, "999 µs"), (1e-3 - 1e-12, "1 ms"), (0.0324, "32.4 ms"),
    (1.0 - 1e-9, "1 s"), (59.0, "59 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 5 min"),
])
def test_a_span_of_time_is_told_in_its_unit(seconds, told):
    assert duration(seconds) == told
