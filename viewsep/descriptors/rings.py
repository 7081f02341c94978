"""Ring spectra: how much the print changes around the object's middle, on rings and at every angular frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from viewsep.descriptors.exposure import opponent_colours
from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray

FINER = 4  # samples of a ring's width and of an angle's step, averaged
CHANNELS = 4  # silhouette, lightness, two opponent colours


@dataclass(frozen=True)
class RingSpectra:
    """Magnitudes of the Fourier transform around the middle of the object, where co-occurrence forgets all places.

    A turn of the picture turns every ring and leaves the magnitudes as they are. `rings` reach from the mask's centroid
    as far as half the picture's height; of each the first `frequencies` (0: the mean) are kept, of the silhouette and
    of the colours as `opponent` sees them. The feature sums to 1.
    """

    smooth_px: Annotated[float, Field(gt=0, le=20)] = 1.5
    rings: Annotated[int, Field(ge=2, le=64)] = 12
    frequencies: Annotated[int, Field(ge=2, le=32)] = 9

    @property
    def name(self) -> str:
        """Registered name."""
        return "rings"

    @property
    def parameters(self) -> dict[str, float | int | str]:
        """What the features depend on."""
        return {"smooth_px": self.smooth_px, "rings": self.rings, "frequencies": self.frequencies}

    @property
    def size(self) -> int:
        """Frequencies of every ring and channel."""
        return self.frequencies * self.rings * CHANNELS

    def describe(self, image: Array, mask: Array | None) -> Array:
        """(H, W, 3) uint8 RGB and (H, W) bool -> (D,) float32. Raises BadInput when no pixel is on the object."""
        channels, inside = opponent_colours(image, mask, self.smooth_px)
        shape = inside.astype(np.float32)
        moments = cv2.moments(shape, binaryImage=True)
        if moments["m00"] == 0:
            raise BadInput("the object covers too little of the picture: no part of it is 4 px wide")
        middle = (moments["m10"] / moments["m00"], moments["m01"] / moments["m00"])
        around = self._around(np.dstack([shape, channels]), middle)
        spectrum: Array = np.abs(np.fft.rfft(around, axis=0)[: self.frequencies])
        width = np.sqrt((np.arange(self.rings) + 0.5) / self.rings)  # an outer ring shows more of the object
        feature: Array = (spectrum * width[None, :, None]).ravel()
        total = float(feature.sum())
        result: Array = (feature / total).astype(np.float32)
        return result

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        """Bhattacharyya's coefficient: (D,) against (N, D) -> (N,) float64 in [0, 1]."""
        product: FloatArray = (np.sqrt(features) @ np.sqrt(feature)).astype(np.float64)
        return product

    def _around(self, picture: Array, middle: tuple[float, float]) -> Array:
        """(h, w, C) -> (angles, rings, C), seen from `middle` (x, y)."""
        angles, channels = 4 * self.frequencies, picture.shape[2]
        fine = cv2.warpPolar(
            picture,
            (FINER * self.rings, FINER * angles),
            middle,
            0.5 * picture.shape[0],
            cv2.INTER_LINEAR | cv2.WARP_FILL_OUTLIERS,
        )
        averaged: Array = fine.reshape(angles, FINER, self.rings, FINER, channels).mean(axis=(1, 3))
        return averaged
