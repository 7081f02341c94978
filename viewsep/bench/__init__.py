"""Experiments and speed: what the method costs and how often it is right."""
