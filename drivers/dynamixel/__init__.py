"""DYNAMIXEL servos of the X series on a serial bus, Protocol 2.0."""
