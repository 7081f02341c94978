"""The photos of one placement of an object, as they are taken: a view set in the making that can be gone on with."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from viewsep.capture.plan import Shot
from viewsep.capture.quality import PhotoQuality
from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.messages import Array, BoolArray, FloatArray, Frame
from viewsep.sim.view_set import LIST_NAME, Use, view_list

STATE_NAME, PREVIEW_NAME = "capture.json", "preview.jpg"
TILE_PX, TILES = 96, 12  # of the preview, and how many in a row


@dataclass(frozen=True, slots=True)
class Photo:
    """A photo that was taken for the shot `number`, seen from `direction` (3,) in the control frame."""

    number: int
    use: str
    direction: tuple[float, ...]
    quality: PhotoQuality
    image: str
    mask: str


class CaptureFolder:
    """Photos, masks and `capture.json`, which says what was planned and what is done.

    Raises BadInput where the folder holds something else, or the photos of another plan.
    """

    def __init__(self, path: Path, plan: dict[str, Any]) -> None:
        self.path = path
        self._plan = json.loads(json.dumps(plan))
        self.photos: list[Photo] = []
        state = path / STATE_NAME
        if state.exists():
            self._go_on(state)
            return
        if path.exists() and any(path.iterdir()):
            raise BadInput(f"{path}: holds other files, and no {STATE_NAME} to go on from; choose another folder")
        for part in ("images", "masks"):
            (path / part).mkdir(parents=True, exist_ok=True)
        self._keep()

    @property
    def done(self) -> set[int]:
        """Numbers of the shots of which there are photos."""
        return {photo.number for photo in self.photos}

    def add(self, shot: Shot, direction: FloatArray, frame: Frame, quality: PhotoQuality) -> None:
        """Keep the photo of a shot, seen from `direction` (3,), with its mask. Raises BadInput when it cannot."""
        assert frame.mask is not None
        name = f"{shot.number:04}.png"
        _write_picture(self.path / "images" / name, cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR))
        _write_picture(self.path / "masks" / name, frame.mask.astype(np.uint8) * 255)
        seen_from = tuple(direction.tolist())
        self.photos.append(Photo(shot.number, shot.use.value, seen_from, quality, f"images/{name}", f"masks/{name}"))
        self._keep()

    def finish(self) -> None:
        """Write the list of views and the preview."""
        rows = [
            (photo.image, np.array(photo.direction), photo.mask, Use(photo.use))
            for photo in sorted(self.photos, key=lambda photo: photo.number)
        ]
        write_whole(self.path / LIST_NAME, view_list(rows), "list of views")
        self.preview()

    def preview(self) -> None:
        """Write a sheet of all photos, what is not the object dimmed."""
        tiles = [_tile(*self._load(photo)) for photo in self.photos]
        if not tiles:
            return
        tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % TILES if len(tiles) > TILES else 0)
        rows = [np.hstack(tiles[i : i + TILES]) for i in range(0, len(tiles), TILES)]
        _write_picture(self.path / PREVIEW_NAME, np.vstack(rows))

    def _load(self, photo: Photo) -> tuple[Array, BoolArray]:
        image = cv2.imread(str(self.path / photo.image), cv2.IMREAD_COLOR)
        mask = cv2.imread(str(self.path / photo.mask), cv2.IMREAD_GRAYSCALE)
        if image is None or mask is None:
            raise BadInput(f"{self.path / photo.image}: is gone or damaged; take the photos again in another folder")
        return np.asarray(image), np.asarray(mask > 127)

    def _go_on(self, state: Path) -> None:
        try:
            told = json.loads(state.read_text(encoding="utf-8"))
            plan, photos = told["plan"], told["photos"]
            self.photos = [Photo(**(one | {"quality": PhotoQuality(**one["quality"])})) for one in photos]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInput(f"{state}: cannot be read ({error}); choose another folder") from error
        differing = sorted(key for key in {*plan, *self._plan} if plan.get(key) != self._plan.get(key))
        if differing:
            key = differing[0]
            raise BadInput(
                f"{state}: was begun with {key} = {plan.get(key)!r}, not {self._plan.get(key)!r}; go on with the same, "
                "or choose another folder"
            )

    def _keep(self) -> None:
        told = {"plan": self._plan, "photos": [asdict(photo) for photo in self.photos]}
        write_whole(self.path / STATE_NAME, json.dumps(told, indent=1).encode(), "state of the photos")


def _write_picture(path: Path, picture: Array) -> None:
    ok, data = cv2.imencode(path.suffix, picture)
    if not ok:
        raise BadInput(f"cannot encode the picture {path}: choose another format")
    write_whole(path, data.tobytes(), "photo")


def _tile(image: Array, mask: BoolArray) -> Array:
    """(TILE_PX, TILE_PX, 3) BGR."""
    dimmed = np.where(mask[..., None], image, image // 4).astype(np.uint8)
    height, width = mask.shape
    side = max(height, width)
    square = np.zeros((side, side, 3), np.uint8)
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = dimmed
    return np.asarray(cv2.resize(square, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA))
