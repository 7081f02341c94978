"""Aspect graphs and the files that hold them (section III.A)."""
