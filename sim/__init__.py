"""The simulated rig: a pybullet world, look-alike objects, camera and motion behind the hardware interfaces."""

if __name__ != "viewsep.sim":
    raise ImportError("this package is viewsep.sim; import it by that name")
