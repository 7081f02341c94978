"""What a library promises before anyone deploys it: which objects are hard to tell apart, and from where."""
