"""Eulerian-on-Lagrangian rods with EoL and EIL nodes (Sánchez-Banderas 2020)."""
