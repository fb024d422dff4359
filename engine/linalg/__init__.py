"""Sparse linear algebra on small dense blocks; knows no physics."""
