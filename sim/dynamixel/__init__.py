"""Emulated DYNAMIXEL servos of the X series: what a serial port sees of them, byte for byte."""
