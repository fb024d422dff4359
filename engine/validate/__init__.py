"""The catalogue of validation cases: error, seconds, order and bar of each."""
