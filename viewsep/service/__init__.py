"""viewsep on Zenoh: a rig, the engine, or both, served to clients and to each other (design section 7)."""
