"""A camera's lens: how points before it become pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.messages import FloatArray


@dataclass(frozen=True, slots=True)
class Lens:
    """Focal length and middle in pixels of pictures `width` x `height`, and radial distortion; square pixels."""

    focal_px: float
    middle_x_px: float
    middle_y_px: float
    radial_2: float
    radial_4: float
    width: int
    height: int

    @staticmethod
    def seeing(field_of_view_rad: float, width: int, height: int) -> Lens:
        """An ideal lens that shows an angle over the smaller side of the picture."""
        focal = 0.5 * min(width, height) / float(np.tan(0.5 * field_of_view_rad))
        return Lens(focal, 0.5 * (width - 1), 0.5 * (height - 1), 0.0, 0.0, width, height)

    @staticmethod
    def of(numbers: FloatArray, width: int, height: int) -> Lens:
        """From `numbers()`."""
        focal, x, y, radial_2, radial_4 = (float(number) for number in numbers)
        return Lens(focal, x, y, radial_2, radial_4, width, height)

    def numbers(self) -> FloatArray:
        """(5,) what can be fitted."""
        return np.array([self.focal_px, self.middle_x_px, self.middle_y_px, self.radial_2, self.radial_4])

    def matrix(self) -> FloatArray:
        """(3, 3) the camera matrix."""
        return np.array(
            [[self.focal_px, 0.0, self.middle_x_px], [0.0, self.focal_px, self.middle_y_px], [0.0, 0.0, 1.0]]
        )

    def distortion(self) -> FloatArray:
        """(5,) OpenCV's distortion coefficients."""
        return np.array([self.radial_2, self.radial_4, 0.0, 0.0, 0.0])

    def project(self, points: FloatArray) -> FloatArray:
        """(N, 3) points in the camera's frame, x right, y down, z ahead -> (N, 2) pixels."""
        flat = points[:, :2] / points[:, 2:]
        radius2 = (flat * flat).sum(axis=1, keepdims=True)
        bent = flat * (1.0 + radius2 * (self.radial_2 + radius2 * self.radial_4))
        pixels: FloatArray = self.focal_px * bent + np.array([self.middle_x_px, self.middle_y_px])
        return pixels
