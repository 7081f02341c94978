"""Real hardware: DYNAMIXEL servos on a serial bus. V4L2 cameras come here."""

if __name__ != "viewsep.drivers":
    raise ImportError("this package is viewsep.drivers; import it by that name")
