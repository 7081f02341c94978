"""Real hardware: DYNAMIXEL servos on a serial bus, cameras that Linux has a driver for."""

if __name__ != "viewsep.drivers":
    raise ImportError("this package is viewsep.drivers; import it by that name")
