"""Component and scene benchmarks: medians, bandwidth share, scaling, peers."""
