"""Perception through an imperfect camera: percepts are those of the object alone, and bad pictures make none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from viewsep.config import Config
from viewsep.interfaces import Look
from viewsep.kinematics import preset
from viewsep.messages import Frame
from viewsep.perception import RigPerception, perceive
from viewsep.perception.background import Background, BackgroundModel, learn_background
from viewsep.perception.empty_rig import captured
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.plugins import make_descriptor
from viewsep.recordings.codec import IMAGE_TOPIC, MASK_TOPIC, decode_frame, encode_frame
from viewsep.session import Rig
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics, MeshRenderer, Pictures
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import Delivery, StagedCamera
from viewsep.sim.world import SimWorld

pytestmark = pytest.mark.needs_pybullet
STAGING = Staging(plate=True, shadow=0.3, seed=2)
DESCRIPTOR = make_descriptor(Config().descriptor)
CAPTURED_DEG = np.arange(0.0, 40.0, 3.0)


@contextmanager
def rig_with(pictures: Pictures | None, staging: Staging) -> Iterator[tuple[Rig, SimWorld]]:
    clock = SimClock()
    world = SimWorld(preset("turntable"), clock, 1, Disturbances())
    delivery = Delivery(latency_s=0.05, drop_rate=0.1)
    camera = StagedCamera(world, pictures, Stage(staging), lambda stamp: world.load_at(stamp).tolist(), delivery)
    rig = Rig(SimMotion(world, 1), camera, world.geometry, clock)
    with ExitStack() as stack:
        rig.motion.connect()
        stack.callback(rig.motion.close)
        rig.camera.connect()
        stack.callback(rig.camera.close)
        yield rig, world


@pytest.fixture(scope="module")
def background() -> BackgroundModel:
    with rig_with(None, STAGING) as (rig, _):
        return learn_background(list(captured(rig, [[angle] for angle in np.radians(CAPTURED_DEG).tolist()])))


def test_the_empty_rig_is_captured_at_the_angles_that_were_reached(background: BackgroundModel) -> None:
    assert background.moving is not None
    np.testing.assert_allclose(np.degrees(background.angles.joints[:, 0]), CAPTURED_DEG, atol=0.5)


def looks_at(mesh: Path, background: BackgroundModel, staging: Staging) -> list[tuple[Look, Frame]]:
    """Looks on the way to 30 degrees, each beside the frame of a camera that sees the object alone."""
    alone = MeshRenderer(mesh)
    finder = ObjectFinder(Segmenter(Background(background)), 128, radius_px=0.47 * staging.object_px)
    seen = []
    with rig_with(MeshRenderer(mesh, CameraOptics(staging.object_px)), staging) as (rig, world):
        perception = RigPerception(rig, DESCRIPTOR, finder)
        rig.motion.move_to([np.radians(30.0)])
        for _ in range(6):
            look = perception.look(rig.clock.now_ns() + 100_000_000, 1.0)
            rotation = world.object_rotation(look.stamp_ns)
            seen.append((look, Frame(look.stamp_ns, 0, *alone.render(rig.geometry.camera_direction, rotation))))
            if look.frame is not None and look.percept is not None:
                again = decoded(look.frame)
                percept = perceive(again, rig.motion.history(look.stamp_ns), rig.geometry, DESCRIPTOR)
                assert DESCRIPTOR.similarity(percept.feature, look.percept.feature[None])[0] > 0.98
                np.testing.assert_array_equal(percept.view_direction, look.percept.view_direction)
    alone.close()
    return seen


def decoded(frame: Frame) -> Frame:
    """The frame as it comes out of a recording."""
    kept = dict(encode_frame(frame))
    return decode_frame(frame.sequence, kept[IMAGE_TOPIC], kept.get(MASK_TOPIC)).decode()


def test_percepts_are_those_of_the_object_alone(product_mesh: Path, background: BackgroundModel) -> None:
    similarities = []
    for look, alone in looks_at(product_mesh, background, STAGING):
        assert look.problem == ""
        assert look.percept is not None
        assert look.frame is not None
        assert look.frame.image.shape == (128, 128, 3)
        assert look.frame.mask is not None
        assert look.frame.mask.mean() == pytest.approx(alone.mask.mean() if alone.mask is not None else 0, rel=0.12)
        feature = DESCRIPTOR.describe(alone.image, alone.mask)
        similarities.append(float(DESCRIPTOR.similarity(look.percept.feature, feature[None])[0]))
    assert min(similarities) > 0.95


def test_pictures_without_a_good_mask_are_no_percepts(product_mesh: Path, background: BackgroundModel) -> None:
    looks = [look for look, _ in looks_at(product_mesh, background, replace(STAGING, removed_s=0.35))]
    bad = [look for look in looks if look.percept is None]
    assert looks[0].percept is not None
    assert len(bad) >= 2
    for look in bad:
        assert "no object stands out" in look.problem
        assert look.frame is not None
        assert (look.frame.image.shape, look.frame.mask) == ((480, 640, 3), None)
