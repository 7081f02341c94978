"""View sets drawn for tests: photos of a printed cylinder on a grey ground, from any direction."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from viewsep.messages import Array, BoolArray

GROUND = 90
Angles = tuple[float, float]


def ring(*azimuths_deg: float, elevation_deg: float = 20.0) -> list[Angles]:
    """Azimuth and elevation of views on one ring."""
    return [(azimuth, elevation_deg) for azimuth in azimuths_deg]


def photo(seed: int, azimuth_deg: float, elevation_deg: float, size_px: int = 64) -> tuple[Array, BoolArray]:
    """Picture (size, size, 3) uint8 RGB and mask of a cylinder with 5 x 12 printed fields that `seed` decides."""
    print_ = np.random.default_rng(seed).integers(0, 256, (5, 12, 3))
    print_[..., 0] = np.where(np.abs(print_[..., 0] - GROUND) < 50, 220, print_[..., 0])  # no field looks like ground
    y, x = np.mgrid[:size_px, :size_px] / size_px - 0.5
    height = 0.3 + 0.0015 * elevation_deg
    mask = (np.abs(x) < 0.25) & (np.abs(y) < height)
    around = np.radians(azimuth_deg) + np.arcsin(np.clip(x / 0.25, -1, 1))
    column = np.floor(around / (2 * np.pi) * 12).astype(int) % 12
    row = np.clip(np.floor((y / height + 1) / 2 * 5), 0, 4).astype(int)
    image = np.full((size_px, size_px, 3), GROUND, np.uint8)
    image[mask] = print_[row, column][mask]
    return image, mask


def write_view_set(
    folder: Path, seed: int, angles_deg: Iterable[Angles], *, masks: bool = True, size_px: int = 64
) -> Path:
    """A folder with views.csv, PNG photos and masks."""
    folder.mkdir(parents=True)
    rows = ["image,azimuth_deg,elevation_deg" + ",mask" * masks]
    for number, (azimuth, elevation) in enumerate(angles_deg):
        image, mask = photo(seed, azimuth, elevation, size_px)
        cv2.imwrite(str(folder / f"v{number:03}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        row = f"v{number:03}.png,{azimuth!r},{elevation!r}"
        if masks:
            cv2.imwrite(str(folder / f"m{number:03}.png"), mask.astype(np.uint8) * 255)
            row += f",m{number:03}.png"
        rows.append(row)
    (folder / "views.csv").write_text("\n".join(rows) + "\n")
    return folder
