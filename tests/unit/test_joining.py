"""What joins the object is noticed when it comes and known while it stays; what turns or moves is not it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from viewsep.errors import BadInput
from viewsep.messages import Array, BoolArray, Frame
from viewsep.perception.background import Background, BackgroundModel, learn_background
from viewsep.perception.boxes import Box, whole
from viewsep.perception.figure_ground import Figure, Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.perception.joining import AWAY, Memory, look_for_joining
from viewsep.perception.tracking import CREDIBLE_AFTER, Track
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import EMPTY

STAGING = Staging(size=(320, 240), object_px=144, shadow=0.25, seed=3)
SHAPE = (240, 320)
THING = Box(170, 110, 210, 160)  # reaches from within the object across its right edge
STEP = np.radians(5.0)


def barrel(turned_rad: float, print_: int = 0, size_px: int = 144) -> tuple[Array, BoolArray]:
    """Picture and mask of an upright printed cylinder, turned about its axis."""
    y, x = np.mgrid[:size_px, :size_px] / (size_px - 1) * 2.0 - 1.0
    mask = (np.abs(x) < 0.6) & (np.abs(y) < 0.75)
    around = np.arcsin(np.clip(x / 0.6, -1, 1)) + turned_rad
    columns = np.floor(around / (2 * np.pi) * 12).astype(int) % 12
    label = np.random.default_rng([print_, 7]).integers(30, 226, (5, 12, 3), np.uint8)
    rows = np.clip(np.floor((y + 0.75) / 1.5 * 5), 0, 4).astype(int)
    return label[rows, columns], np.asarray(mask)


def seen(turned_rad: float, number: int = 0, staging: Staging = STAGING, print_: int = 0) -> Array:
    return Stage(staging).exposed(*barrel(turned_rad, print_), [0.0], number * 250_000_000, number)[0]


def covered(image: Array, thing: Box = THING) -> Array:
    image = image.copy()
    image[thing.part] = (200, 40, 160)
    return image


@pytest.fixture(scope="module")
def desk() -> BackgroundModel:
    stage = Stage(STAGING)
    return learn_background([(stage.exposed(*EMPTY, [0.0], k * 10**8, 10_000 + k)[0], [0.0]) for k in range(3)])


def looked(desk: BackgroundModel, images: list[Array], step: float = STEP, radius_px: float = 68.0) -> list[Figure]:
    """Figures of pictures that follow each other while the object turns."""
    figures, track = [], Track()
    for number, image in enumerate(images):
        figures.append(Segmenter(Background(desk), radius_px=radius_px).segment(image, [number * step], track))
        track = figures[-1].track
    return figures


def test_what_joins_the_object_is_refused_until_it_is_taken_away(desk: BackgroundModel) -> None:
    images = [seen(k * STEP, k) for k in range(CREDIBLE_AFTER + 7)]
    stays = range(3, CREDIBLE_AFTER + 5)  # longer than it takes to believe another object
    figures = looked(desk, [covered(image) if k in stays else image for k, image in enumerate(images)])
    assert [bool(figure.problem) for figure in figures] == [k in stays for k in range(len(images))]
    assert all(figure.quality.score < 0.5 for figure in figures if figure.problem)
    assert "something has joined the object" in figures[3].problem
    assert figures[0].quality.parts["joined"] == 1.0


def test_what_is_held_in_a_hand_stays_known_while_it_trembles(desk: BackgroundModel) -> None:
    images = [seen(k * STEP, k) for k in range(3)]
    for k in range(3, 10):
        aside = 2 * (k % 3)
        thing = Box(THING.left + aside, THING.top + aside, THING.right + aside, THING.bottom + aside)
        images.append(covered(seen(k * STEP, k), thing))
    assert all("joined" in figure.problem for figure in looked(desk, images)[3:])


@pytest.mark.parametrize("step_deg", [0.0, 2.0, 10.0, 30.0, 60.0])
def test_an_object_that_turns_is_joined_by_nothing(desk: BackgroundModel, step_deg: float) -> None:
    step = float(np.radians(step_deg))
    for radius_px in (0.0, 68.0):
        figures = looked(desk, [seen(k * step, k) for k in range(7)], step, radius_px)
        assert not any(figure.problem for figure in figures)


def test_what_a_long_turn_may_have_brought_into_sight_is_not_doubted(desk: BackgroundModel) -> None:
    images = [seen(0.0), covered(seen(np.pi / 3, 1))]
    assert "joined" not in looked(desk, images, np.pi / 3)[1].problem


def test_an_object_that_is_moved_or_another_one_is_joined_by_nothing(desk: BackgroundModel) -> None:
    moved = replace(STAGING, offset_px=(-40, 10))
    images = [seen(k * STEP, k) for k in range(3)]
    for others in ([seen(k * STEP, k, moved) for k in (3, 4)], [seen(k * STEP, k, print_=1) for k in (3, 4)]):
        assert not any(figure.problem for figure in looked(desk, [*images, *others]))


def test_other_light_joins_nothing(desk: BackgroundModel) -> None:
    images = [seen(k * STEP, k, replace(STAGING, gain=1.0 if k < 3 else 0.7)) for k in range(6)]
    assert not any(figure.problem for figure in looked(desk, images))


def test_nothing_is_remembered_of_what_was_there_before_the_object_was_away(desk: BackgroundModel) -> None:
    bare = Stage(STAGING).exposed(*EMPTY, [0.0], 0, 5)[0]
    images = [seen(0.0), covered(seen(0.0, 1)), *[bare] * AWAY, covered(seen(0.0, 2))]
    figures = looked(desk, images, 0.0)
    assert "joined" in figures[1].problem
    assert figures[1 + AWAY].track.memory.last is None
    assert figures[-1].problem == ""
    still = looked(desk, [*images[:2], bare, images[-1]], 0.0)  # one dropped picture is no reason to forget
    assert "joined" in still[-1].problem


def test_a_finder_says_it_in_words(desk: BackgroundModel) -> None:
    finder = ObjectFinder(Segmenter(Background(desk)), 64)
    finder.find(Frame(0, 0, seen(0.0), None), [0.0])
    with pytest.raises(BadInput, match=r"something has joined the object .* of what stands out is new"):
        finder.find(Frame(250_000_000, 1, covered(seen(0.0, 1)), None), [0.0])


@pytest.mark.parametrize("where", [(0, 0), (300, 220), (140, 0)])
def test_figures_at_the_picture_s_border_are_compared_as_well(where: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    image = cv2.resize(rng.integers(0, 256, (12, 16, 3), np.uint8), (320, 240), interpolation=cv2.INTER_NEAREST)
    mask = np.zeros(SHAPE, np.uint8)
    mask[where[1] : where[1] + 20, where[0] : where[0] + 20] = 1
    first = look_for_joining(image, mask, whole(SHAPE), None, (0.0,), Memory())
    again = look_for_joining(image, mask, whole(SHAPE), None, (0.0,), first.memory)
    assert (first.share, again.share) == (0.0, 0.0)
    assert look_for_joining(image, np.zeros_like(mask), whole(SHAPE), None, (0.0,), again.memory).share == 0.0


def slab(turned_rad: float, depth: float) -> tuple[Array, Array]:
    """Picture and mask of a box 200 x (200 * depth) seen from above the table's edge, each side of one colour."""
    corners = np.array([[-1, -depth], [1, -depth], [1, depth], [-1, depth]]) * 100.0
    turn = np.array([[np.cos(turned_rad), -np.sin(turned_rad)], [np.sin(turned_rad), np.cos(turned_rad)]])
    image, mask = np.full((240, 320, 3), 255, np.uint8), np.zeros(SHAPE, np.uint8)
    placed = corners @ turn.T
    for side, colour in enumerate([(200, 30, 30), (30, 180, 40), (40, 60, 220), (220, 210, 30)]):
        (x0, y0), (x1, y1) = placed[side], placed[(side + 1) % 4]
        if x1 > x0 and (x1 - x0) * (y0 + y1) - (y1 - y0) * (x0 + x1) < 0:  # to be seen
            columns = slice(round(160 + x0), round(160 + x1))
            image[40:200, columns], mask[40:200, columns] = colour, 1
    return image, mask


@pytest.mark.parametrize("depth", [0.05, 0.25, 1.0])
@pytest.mark.parametrize("step_deg", [5.0, 10.0, 15.0, 25.0, 60.0])
@pytest.mark.parametrize("begin_deg", [0.0, 85.0, 90.0, 180.0])
def test_sides_that_come_into_sight_join_nothing(depth: float, step_deg: float, begin_deg: float) -> None:
    for known_px in (0.0, 100.0 * float(np.hypot(1, depth))):
        memory = Memory()
        for angle in np.radians(np.arange(begin_deg, begin_deg + 100.0, step_deg)):
            image, mask = slab(float(angle), depth)
            assert mask.any()
            joining = look_for_joining(image, mask, whole(SHAPE), None, (float(angle),), memory, known_px)
            assert joining.share == 0.0
            memory = joining.memory
