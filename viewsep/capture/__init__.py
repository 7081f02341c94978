"""Photographing an object on the rig, from views that are planned, checked and kept as a view set to learn from."""
