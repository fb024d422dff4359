"""The scenes that ship with Strandline."""
