"""What a rig must know of itself: how late its camera's stamps are, its joints' play, and where its axes lie."""
