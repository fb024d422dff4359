"""Discrete elastic rods."""
