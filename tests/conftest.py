"""Kernels compiled by tests are kept per version of the engine's sources, as everywhere else."""

from engine.run.compile_cache import prepare_compile_cache

prepare_compile_cache()
