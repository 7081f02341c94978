"""Path hypotheses: from percepts to poses and ratings (section IV)."""
