"""Machines that lack a package to compare with."""

import builtins

import pytest


def without(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    """Let the import of a package fail as it does where it is not installed."""
    real = builtins.__import__

    def imported(name, *rest):
        if name == package:
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", imported)
