"""Bulk liquid: particles on a sparse staggered grid."""
