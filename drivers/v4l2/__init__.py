"""Cameras that Linux has a driver for (V4L2): pictures through OpenCV, the rest through the kernel's ioctls."""
