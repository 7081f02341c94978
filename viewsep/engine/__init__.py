"""The pure engine: step(state, event) -> (state, commands)."""
