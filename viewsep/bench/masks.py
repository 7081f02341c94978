"""How good the masks of figure-ground segmentation are, and whether bad ones are noticed.

Photos beside the masks that come with them, photos cut out and put on the desk, and staged scenes: an object on a
turntable before a cluttered desk or a plain backdrop, with shadow, printed plate, gripper, wandering exposure, noise
and a shaking camera; and scenes in which something goes wrong half-way, where most masks ought to be refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from viewsep.bench.journal import Row
from viewsep.bench.resampling import interval95, resamples
from viewsep.bench.summary import wilson95
from viewsep.geometry import random_rotation
from viewsep.kinematics import preset
from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.perception.background import Background, learn_background
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.holder import learn_holder
from viewsep.perception.plain import PlainBackdrop
from viewsep.perception.quality import Limits
from viewsep.perception.tracking import Track
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import EMPTY
from viewsep.sim.view_set import read_view_set

BAD_IOU = 0.8  # a mask that agrees less with the truth is bad; so is any mask of an object that is not all there
LOOK_S = 0.25
STILL_CAPTURES = 4
QUANTILES = (0.01, 0.05, 0.25, 0.5)
PHOTOS, ON_DESK = "photos, masks as given", "photos on the desk"
PHOTO_LIMITS = Limits(border_share=1.0, largest_share=0.95)  # photos may be cut close around the object
Turned = Sequence[tuple[float, Array, BoolArray]]
"""An object's pictures and masks by joint angle, radians."""

Spoil = Callable[[Array, BoolArray], tuple[Array, BoolArray]]
"""What goes wrong with a picture, and what then is the true mask."""


@dataclass(frozen=True, slots=True)
class MaskScene:
    """A staged scene. `wrong` scenes go wrong half-way, through their staging's times or `spoil`."""

    name: str
    staging: Staging
    wrong: bool = False
    spoil: Spoil | None = None
    half_way: tuple[str, ...] = ()  # keys of the staging that are set to that moment


def _bumped(image: Array, mask: BoolArray) -> tuple[Array, BoolArray]:
    """The camera looks 14 pixels aside."""
    moved = cv2.warpAffine(image, np.array([[1.0, 0.0, 12.0], [0.0, 1.0, 7.0]]), image.shape[1::-1], borderMode=1)
    return np.asarray(moved), np.roll(mask, (7, 12), (0, 1))


def _reached_into(image: Array, mask: BoolArray) -> tuple[Array, BoolArray]:
    """An arm comes from the right and touches the object."""
    y, x = (int(places.mean()) for places in np.nonzero(mask))
    arm = np.zeros(mask.shape, np.uint8)
    cv2.line(arm, (image.shape[1] + 20, y + 60), (x + 30, y), 1, 70)
    dressed = image.copy()
    dressed[arm > 0] = (205, 150, 120)
    return dressed, mask & (arm == 0)


def _joined_by_another(image: Array, mask: BoolArray) -> tuple[Array, BoolArray]:
    """Something of a third of the object's width is put before it and covers its edge."""
    y, x = (int(places.mean()) for places in np.nonzero(mask))
    cube = np.zeros(mask.shape, np.uint8)
    cv2.rectangle(cube, (x + 50, y), (x + 120, y + 80), 1, -1)
    image = image.copy()
    image[cube > 0] = (60, 130, 190)
    return image, mask & (cube == 0)


SCENES = (
    MaskScene("desk", Staging()),
    MaskScene("desk, plate", Staging(plate=True)),
    MaskScene("desk, gripper", Staging(gripper=True)),
    MaskScene("desk, plate, gripper", Staging(plate=True, gripper=True)),
    MaskScene("backdrop", Staging(background="plain")),
    MaskScene("backdrop, gripper", Staging(background="plain", gripper=True)),
    MaskScene("object is taken away", Staging(), True, half_way=("removed_s",)),
    MaskScene("object leaves the picture", Staging(moved_px=(300, 40)), True, half_way=("moved_s",)),
    MaskScene("object is moved", Staging(), True, half_way=("moved_s",)),
    MaskScene("other lamps", Staging(), True, half_way=("switched_s",)),
    MaskScene("camera is bumped", Staging(), True, _bumped),
    MaskScene("something joins it", Staging(), True, _joined_by_another),
    MaskScene("arm in the picture", Staging(plate=True), True, _reached_into),
)


def staged_rows(seeds: Sequence[int], views: int, every_deg: float, heard: Callable[[], None]) -> list[Row]:
    """A row per look: generated product `seed` on a turntable that goes round once in `views` looks, in every scene.

    What turns with the rig was captured every `every_deg`.
    """
    rows: list[Row] = []
    for seed in seeds:
        turned = _turned(seed, views)
        for scene in SCENES:
            rows += _looks(scene, str(seed), seed, turned, every_deg)
            heard()
    return rows


def photo_rows(folder: Path, views: int, heard: Callable[[], None]) -> list[Row]:
    """A row per photo of a view set, cut out of its plain backdrop without knowing any other, beside the mask it has.

    About `views` of them, as they were cut out, are then put on the desk, where the truth is known. Raises BadInput.
    """
    view_set = read_view_set(folder)
    segmenter, rows = Segmenter(PlainBackdrop(), limits=PHOTO_LIMITS), []
    cut: list[tuple[float, Array, BoolArray]] = []
    for index, name in enumerate(view_set.masks):
        image, truth = view_set.load(index)
        figure = segmenter.segment(image, (), Track())
        if name:  # otherwise there is no other mask to compare with
            rows.append(_row(PHOTOS, False, view_set.name, index, figure.mask, truth, figure.problem, whole=True))
        if index % max(1, len(view_set.masks) // views) == 0 and not figure.problem:
            cut.append((float(np.radians(view_set.angles_deg[index, 0])), image, figure.mask))
    staging = Staging(seed=sum(view_set.name.encode()))  # a desk of its own
    rows += _looks(MaskScene(ON_DESK, staging), view_set.name, staging.seed, cut)
    heard()
    return rows


def masks_summary(rows: Sequence[Row], seed: int = 0) -> dict[str, dict[str, Any]]:
    """Figures by scene, then of all photos, all good scenes and all in which something went wrong."""
    groups = {
        scene: [row for row in rows if row["scene"] == scene] for scene in dict.fromkeys(r["scene"] for r in rows)
    }
    staged = [row for row in rows if row["scene"] not in (PHOTOS, ON_DESK)]
    groups["all staged, nothing wrong"] = [row for row in staged if not row["wrong"]]
    groups["all staged, something wrong"] = [row for row in staged if row["wrong"]]
    return {name: _figures(group, seed) for name, group in groups.items() if group}


def _figures(rows: Sequence[Row], seed: int) -> dict[str, Any]:
    good = [row for row in rows if row["whole"]]
    accepted = [row for row in rows if row["accepted"]]
    bad = [row for row in rows if row["bad"]]
    through = [row for row in bad if row["accepted"]]
    refused = [row for row in rows if not row["bad"] and not row["accepted"]]
    return {
        "looks": len(rows),
        "sequences": len({(row["scene"], row["sequence"]) for row in rows}),
        **_quantiles("iou", good, seed),
        **_quantiles("iou_accepted", [row for row in accepted if row["whole"]], seed),
        "bad": len(bad),
        "bad_let_through": len(through),
        "bad_let_through_of_accepted": len(through) / len(accepted) if accepted else None,
        "bad_let_through_of_accepted_wilson95": wilson95(len(through), len(accepted)) if accepted else None,
        "bad_let_through_of_bad": len(through) / len(bad) if bad else None,
        "bad_let_through_of_bad_wilson95": wilson95(len(through), len(bad)) if bad else None,
        "good_refused": len(refused),
        "good": len(rows) - len(bad),
    }


def _quantiles(key: str, rows: Sequence[Row], seed: int) -> dict[str, Any]:
    """Quantiles of the intersection over union, the median with its bootstrap interval over the sequences."""
    if not rows:
        return {f"{key}_quantiles": None, f"{key}_median_bootstrap95": None}
    order = sorted(rows, key=lambda row: float(row["iou"]))
    iou = np.array([row["iou"] for row in order])
    names = sorted({(row["scene"], row["sequence"]) for row in order})
    group = np.array([names.index((row["scene"], row["sequence"])) for row in order])
    drawn = resamples(len(names), np.random.default_rng([seed, 27]))[:, group].cumsum(axis=1)
    medians: FloatArray = iou[np.argmax(drawn >= 0.5 * drawn[:, -1:], axis=1)]
    return {
        f"{key}_quantiles": {f"{q:g}": float(np.quantile(iou, q)) for q in QUANTILES},
        f"{key}_median_bootstrap95": interval95(medians),
    }


def _turned(seed: int, views: int) -> Turned:
    """The object's pictures and masks at joint angles once around, in an unknown grasp."""
    geometry = preset("turntable")
    renderer = open_renderer(f"generated:{seed}", CameraOptics(Staging().object_px))
    grasp = random_rotation(np.random.default_rng([seed, 1]))
    angles = np.arange(views) * 2.0 * np.pi / views
    try:
        return [
            (float(q), *renderer.render(geometry.camera_direction, geometry.holder_rotation([q]) @ grasp))
            for q in angles
        ]
    finally:
        renderer.close()


def _segmenter(staging: Staging, every_deg: float) -> Segmenter:
    """What is learned of the empty rig of a scene: background by joint angle, or the holder before the backdrop."""
    moves = staging.plate or staging.gripper
    still = replace(staging, removed_s=np.inf, moved_s=np.inf, switched_s=np.inf)
    frames = list(_empty(Stage(still), np.arange(0.0, 360.0, every_deg) if moves else np.zeros(STILL_CAPTURES)))
    if staging.background == "desk":
        return Segmenter(Background(learn_background(frames)))
    return Segmenter(PlainBackdrop(), learn_holder(frames, PlainBackdrop()) if staging.gripper else None)


def _empty(stage: Stage, angles_deg: FloatArray) -> Iterator[tuple[Array, list[float]]]:
    for number, angle in enumerate(np.radians(angles_deg).tolist()):
        yield stage.exposed(*EMPTY, [angle], round(number * 1e8), 1_000_000 + number)[0], [angle]


def _looks(scene: MaskScene, sequence: str, seed: int, turned: Turned, every_deg: float = 360.0) -> list[Row]:
    half_way_s = LOOK_S * (len(turned) // 2)
    times: dict[str, Any] = dict.fromkeys(scene.half_way, half_way_s)
    staging = replace(scene.staging, seed=seed, **times)
    stage, segmenter, track, rows = Stage(staging), _segmenter(staging, every_deg), Track(), []
    for number, (angle, picture, mask) in enumerate(turned):
        joints = [angle + np.radians(every_deg / 2)]  # as far as can be from what was captured
        stamp_ns = round(number * LOOK_S * 1e9)
        image, truth = stage.exposed(picture, mask, joints, stamp_ns, number)
        whole = not any(edge.any() for edge in (truth[0], truth[-1], truth[:, 0], truth[:, -1])) and bool(truth.any())
        if scene.spoil is not None and stamp_ns * 1e-9 >= half_way_s:
            image, truth = scene.spoil(image, truth)
        figure = segmenter.segment(image, joints, track)
        track = figure.track
        rows.append(_row(scene.name, scene.wrong, sequence, number, figure.mask, truth, figure.problem, whole=whole))
    return rows


def _row(
    scene: str, wrong: bool, sequence: str, index: int, mask: BoolArray, truth: BoolArray, problem: str, *, whole: bool
) -> Row:
    union = int((mask | truth).sum())
    iou = float((mask & truth).sum() / union) if union else 0.0
    return {
        "scene": scene,
        "wrong": wrong,
        "sequence": sequence,
        "index": index,
        "iou": iou,
        "whole": whole,
        "bad": iou < BAD_IOU or not whole,
        "accepted": not problem,
        "problem": problem,
    }
