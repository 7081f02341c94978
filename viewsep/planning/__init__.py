"""Which view to drive to next (sections III.C and IV.E)."""
