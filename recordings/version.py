"""The layout of recordings, counted up when readers of the one before would misunderstand it."""

VERSION = 2
"""1 (not written in the file): one order for everything, messages counted per topic.
2: pictures in chunks of their own, all other messages of ours counted together, keyframes, standard messages beside."""

RECOVERY = "recovery"
"""The metadata record of a file that was recovered from a damaged one."""
