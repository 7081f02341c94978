"""Figure and ground: one object without holes, on light that changes, and masks that are refused for a reason."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from viewsep.config import Config, load_config, parse_config
from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.errors import BadConfig, BadInput
from viewsep.framing import FRAME_FILL
from viewsep.geometry import axis_rotation
from viewsep.kinematics import preset
from viewsep.messages import Array, BoolArray, Frame, JointState
from viewsep.perception import perceive
from viewsep.perception.background import Background, BackgroundModel, learn_background
from viewsep.perception.boxes import Box, around, whole
from viewsep.perception.components import largest_plausible
from viewsep.perception.crop import enclosing_circle, squared
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.finder import FORGET_NS, ObjectFinder
from viewsep.perception.holder import learn_holder, still_holder
from viewsep.perception.plain import PlainBackdrop
from viewsep.perception.quality import Limits
from viewsep.perception.region import FixedRegion
from viewsep.perception.setup import finder_of
from viewsep.perception.shadow import soft_shadow
from viewsep.perception.stored import load_background, load_holder, save_background, save_holder
from viewsep.perception.tracking import CREDIBLE_AFTER, Track, region_of_interest
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import EMPTY
from viewsep.sim.view_set import read_view_set

SIZE = (320, 240)
SHAPE = (240, 320)
CALM = Staging(size=SIZE, object_px=144, shadow=0.25, seed=3)


def thing(seed: int = 0, size_px: int = 144) -> tuple[Array, BoolArray]:
    """Picture and mask of a printed disc."""
    print_ = np.random.default_rng(seed).integers(0, 256, (6, 6, 3), np.uint8)
    picture = cv2.resize(print_, (size_px, size_px), interpolation=cv2.INTER_NEAREST)
    y, x = np.mgrid[:size_px, :size_px] - (size_px - 1) / 2
    return picture, np.asarray(np.hypot(x, y) < 0.47 * size_px)


def empty(staging: Staging, *angles_deg: float) -> list[tuple[Array, list[float]]]:
    stage = Stage(staging)
    return [
        (stage.exposed(*EMPTY, [angle], number * 10**8, 10_000 + number)[0], [angle])
        for number, angle in enumerate(np.radians(angles_deg).tolist())
    ]


def overlap(a: BoolArray, b: BoolArray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.fixture(scope="module")
def desk() -> BackgroundModel:
    return learn_background(empty(CALM, 0, 0, 0))


def seen(staging: Staging, number: int = 0, angle: float = 0.0) -> tuple[Array, BoolArray]:
    return Stage(staging).exposed(*thing(), [angle], number * 250_000_000, number)


shapes = st.lists(
    st.tuples(st.integers(0, 79), st.integers(0, 59), st.integers(1, 25), st.integers(0, 12)), min_size=1, max_size=5
)


@given(shapes, st.integers(0, 2**32 - 1))
def test_what_is_chosen_is_one_piece_without_holes(rings: list[tuple[int, int, int, int]], seed: int) -> None:
    differs = np.zeros((60, 80), np.uint8)
    for x, y, radius, hole in rings:
        cv2.circle(differs, (x, y), radius, 1, -1)
        cv2.circle(differs, (x, y), min(hole, radius - 1), 0, -1)
    differs |= (np.random.default_rng(seed).random(differs.shape) < 0.01).astype(np.uint8)
    found = largest_plausible(differs)
    assert found.area == np.count_nonzero(found.mask)
    pieces, _ = cv2.connectedComponents(found.mask)
    ground, _ = cv2.connectedComponents(np.pad(1 - found.mask, 1, constant_values=1), connectivity=8)
    assert pieces == (2 if found.area else 1)
    assert ground == 2  # with the outside: no hole
    assert found.rival >= 0.0


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.02))
def test_specks_are_no_object(seed: int, share: float) -> None:
    differs = (np.random.default_rng(seed).random((60, 80)) < share).astype(np.uint8)
    assert largest_plausible(differs).area == 0


def test_of_two_alike_the_one_near_the_place_before_is_chosen() -> None:
    differs = np.zeros((60, 120), np.uint8)
    for x in (30, 90):
        cv2.circle(differs, (x, 30), 15, 1, -1)
    for x in (30, 90):
        assert largest_plausible(differs, near=(float(x), 30.0)).mask[30, x]
    assert largest_plausible(differs).rival == pytest.approx(1.0)


def test_a_soft_shadow_is_ground_and_another_colour_is_not() -> None:
    ground = np.full((60, 80, 3), (150, 120, 90), np.uint8)
    x = np.linspace(0.55, 0.97, 80)[None, :, None]
    assert soft_shadow((ground * x).astype(np.uint8), ground).mean() > 0.98
    assert soft_shadow((ground * x * [1.0, 0.7, 1.0]).astype(np.uint8), ground).sum() == 0
    assert soft_shadow(ground // 4, ground).sum() == 0  # too dark
    assert soft_shadow(np.zeros_like(ground), np.zeros_like(ground)).sum() == 0
    edge = np.where(np.arange(80)[None, :, None] < 40, 0.6, 1.0)
    assert soft_shadow((ground * edge).astype(np.uint8), ground)[:, 38:42].sum() == 0


def test_print_in_a_shadow_is_ground_and_print_on_an_object_is_not() -> None:
    ground = np.full((60, 80, 3), (150, 120, 90), np.uint8)
    for x in range(10, 80, 16):
        ground[:, x : x + 3] = (60, 60, 60)
    model = learn_background([(ground, [0.0])])
    shaken = np.roll(cv2.GaussianBlur(ground, (0, 0), 0.6), 1, axis=1)  # by a pixel
    shadow = np.clip(0.7 * shaken, 0, 255).astype(np.uint8)
    shadow[:, 40:] = np.clip(0.7 * np.roll(shaken, 7, axis=1)[:, 40:], 0, 255).astype(np.uint8)  # lines elsewhere
    differs = Background(model).difference(shadow, [0.0], whole(ground.shape[:2])).differs
    assert differs[5:-5, 5:35].mean() < 0.02
    assert differs[5:-5, 45:75].mean() > 0.2


def test_sides_that_look_like_the_ground_belong_to_the_object() -> None:
    differs = np.zeros((120, 160), np.uint8)
    differs[20:60, 40:120] = differs[60:100, 100:120] = differs[90:100, 40:100] = 1  # a side does not differ, ...
    differs[60:90, 40:42] = 1  # ... but its edge does
    differs[70:74, 40:42] = 0  # with a break
    found = largest_plausible(differs).mask
    assert found[25:95, 45:115].mean() > 0.98
    half = np.zeros_like(differs)
    half[20:100, 40:80] = half[20:36, 80:120] = half[90:100, 80:120] = 1
    shade = np.zeros_like(differs)
    shade[36:90, 76:118] = 1  # a side in shade within the outline
    shade[40:110, 122:150] = 1  # and the shadow beside
    assert largest_plausible(half, shade=shade).mask[45:85, 82:110].all()
    assert not largest_plausible(half, shade=shade).mask[:, 124:].any()
    assert not largest_plausible(half).mask[45:85, 90:110].any()


@pytest.mark.parametrize("offset", [0.0, 0.1, 0.3])
def test_the_object_is_found_on_a_desk_in_changed_light(desk: BackgroundModel, offset: float) -> None:
    overlaps, track = [], Track()
    for number in range(8):
        image, truth = seen(replace(CALM, exposure_offset=offset), number)
        figure = Segmenter(Background(desk)).segment(image, [0.0], track)
        track = figure.track
        assert figure.problem == ""
        assert 0.5 <= figure.quality.score <= 1.0
        overlaps.append(overlap(figure.mask, truth))
    assert np.median(overlaps) > 0.93  # of an object 135 pixels wide


def test_clipped_light_is_no_object() -> None:
    ground = np.full((*SHAPE, 3), 120, np.uint8)
    ground[:, 200:] = 235
    bright = np.clip(ground * 1.25, 0, 255).astype(np.uint8)
    difference = Background(learn_background([(ground, [0.0])])).difference(bright, [0.0], whole(SHAPE))
    assert not difference.differs.any()
    assert difference.problem == ""


def test_the_object_is_found_before_a_backdrop_beside_a_holder() -> None:
    staging = replace(CALM, background="plain", gripper=True, exposure_offset=0.0)
    holder = learn_holder(empty(staging, *range(0, 360, 10)), PlainBackdrop())
    for number in range(6):
        angle = np.radians(17.0 * number)
        image, truth = seen(staging, number, angle)
        figure = Segmenter(PlainBackdrop(), holder).segment(image, [angle], Track())
        assert figure.problem == ""
        assert overlap(figure.mask, truth) > 0.9


def test_what_turns_with_the_joints_is_ground_where_it_was_captured() -> None:
    staging = replace(CALM, plate=True, gripper=True)
    half = learn_background(empty(staging, *range(0, 180, 4)))
    image, truth = seen(staging, 0, np.radians(90.0))
    figure = Segmenter(Background(half)).segment(image, [np.radians(90.0)], Track())
    assert figure.problem == ""
    assert overlap(figure.mask, truth) > 0.9
    image, _ = seen(staging, 0, np.radians(270.0))
    figure = Segmenter(Background(half)).segment(image, [np.radians(270.0)], Track())
    assert "not captured near these joint angles" in figure.problem
    full_turn = Segmenter(Background(half)).segment(seen(staging)[0], [2.0 * np.pi], Track())
    assert full_turn.problem == ""


def test_masks_that_cannot_be_trusted_are_refused_with_the_reason(desk: BackgroundModel) -> None:
    segmenter, track = Segmenter(Background(desk)), Track()
    for number in range(3):
        track = segmenter.segment(seen(CALM, number)[0], [0.0], track).track
    removed = segmenter.segment(empty(CALM, 0)[0][0], [0.0], track)
    assert "no object stands out" in removed.problem
    out = segmenter.segment(seen(replace(CALM, offset_px=(140, 0)))[0], [0.0], track)
    assert "is not all in the picture" in out.problem
    lamps = segmenter.segment(seen(replace(CALM, switched_s=0.0))[0], [0.0], track)
    assert lamps.problem
    moved = np.roll(seen(CALM)[0], (13, 19), (0, 1))
    assert segmenter.segment(moved, [0.0], track).problem
    small = segmenter.segment(seen(replace(CALM, object_px=92))[0], [0.0], track)
    assert "area changed by a factor of" in small.problem
    assert all(figure.quality.score < 0.5 or figure is lamps for figure in (removed, out, small))


def test_another_object_is_believed_when_it_stays(desk: BackgroundModel) -> None:
    segmenter, track, other = Segmenter(Background(desk)), Track(), replace(CALM, object_px=88)
    for number in range(3):
        track = segmenter.segment(seen(CALM, number)[0], [0.0], track).track
    problems = []
    for number in range(CREDIBLE_AFTER + 2):
        figure = segmenter.segment(seen(other, number)[0], [0.0], track)
        track = figure.track
        problems.append(bool(figure.problem))
    assert problems == [True] * CREDIBLE_AFTER + [False] * 2


def test_an_object_that_was_moved_is_found_again(desk: BackgroundModel) -> None:
    segmenter = Segmenter(Background(desk))
    track = segmenter.segment(seen(CALM)[0], [0.0], Track()).track
    assert region_of_interest(track, SHAPE) != whole(SHAPE)
    image, truth = seen(replace(CALM, offset_px=(-70, 20)), 1)
    figure = segmenter.segment(image, [0.0], track)
    assert figure.problem == ""
    assert overlap(figure.mask, truth) > 0.9


def test_pictures_that_do_not_suit_the_background_are_bad_input(desk: BackgroundModel) -> None:
    with pytest.raises(BadInput, match="captured at 320 x 240"):
        Segmenter(Background(desk)).segment(np.zeros((60, 80, 3), np.uint8), [0.0], Track())
    with pytest.raises(BadInput, match="takes \\(H, W, 3\\) uint8"):
        Segmenter(Background(desk)).segment(np.zeros((60, 80), np.uint8), [0.0], Track())
    with pytest.raises(BadInput, match="at least one"):
        learn_background([])
    with pytest.raises(BadInput, match="1 joints, but this rig has 2"):
        Background(learn_background(empty(replace(CALM, plate=True), 0, 90))).difference(
            seen(CALM)[0], [0.0, 0.0], whole(SHAPE)
        )


def test_a_cluttered_border_is_no_backdrop() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3), np.uint8)
    assert "has one colour" in Segmenter(PlainBackdrop()).segment(noise, [0.0], Track()).problem


def test_a_region_is_the_object_without_the_holder() -> None:
    bar = np.zeros(SHAPE, bool)
    bar[:, 50:60] = True
    image = np.zeros((*SHAPE, 3), np.uint8)
    figure = FixedRegion(Box(40, 20, 80, 60), still_holder(bar)).segment(image, [0.0], Track())
    assert figure.mask.sum() == 40 * 30
    assert around(figure.mask) == Box(40, 20, 80, 60)
    with pytest.raises(BadInput, match=r"perception\.region"):
        FixedRegion(Box(40, 20, 400, 60)).segment(image, [0.0], Track())
    with pytest.raises(BadInput, match="holder's mask is 320 x 240"):
        FixedRegion(Box(0, 0, 9, 9), still_holder(bar)).segment(image[:50, :50], [0.0], Track())


def test_what_was_learned_is_stored_and_damage_is_told(tmp_path: Path, desk: BackgroundModel) -> None:
    turning = learn_background(empty(replace(CALM, plate=True), *range(0, 360, 30)))
    for number, model in enumerate((desk, turning)):
        path = tmp_path / f"{number}.npz"
        save_background(model, path)
        again = load_background(path)
        np.testing.assert_array_equal(again.still, model.still)
        np.testing.assert_array_equal(again.turning, model.turning)
        assert (again.moving, again.noise) == (model.moving, model.noise)
        np.testing.assert_array_equal(again.angles.joints, model.angles.joints)
    holder = still_holder(thing()[1])
    save_holder(holder, tmp_path / "holder.npz")
    np.testing.assert_array_equal(load_holder(tmp_path / "holder.npz").masks, holder.masks)
    cv2.imwrite(str(tmp_path / "holder.png"), thing()[1].astype(np.uint8) * 255)
    np.testing.assert_array_equal(load_holder(tmp_path / "holder.png").masks, holder.masks)
    data = bytearray((tmp_path / "0.npz").read_bytes())
    for cut in (0, 10, len(data) // 2):
        (tmp_path / "cut.npz").write_bytes(data[:cut])
        with pytest.raises(BadInput, match=r"cut\.npz is damaged"):
            load_background(tmp_path / "cut.npz")
    with np.load(tmp_path / "0.npz") as file:
        arrays = {name: file[name] for name in file.files}
    arrays["still"] = arrays["still"] + np.uint8(1)
    np.savez(tmp_path / "changed.npz", allow_pickle=False, **arrays)
    with pytest.raises(BadInput, match=r"changed\.npz is damaged"):
        load_background(tmp_path / "changed.npz")
    with pytest.raises(BadInput, match="holds no holder"):
        load_holder(tmp_path / "0.npz")
    with pytest.raises(BadInput, match="capture the empty rig first"):
        load_background(tmp_path / "missing.npz")
    (tmp_path / "holder.txt").write_text("no picture")
    with pytest.raises(BadInput, match="neither a picture nor"):
        load_holder(tmp_path / "holder.txt")


@settings(max_examples=30)
@given(st.floats(8.0, 100.0), st.floats(30.0, 130.0), st.floats(30.0, 90.0), st.sampled_from([48, 64, 128]))
def test_a_cut_out_ball_is_as_large_as_in_renders(radius: float, x: float, y: float, size_px: int) -> None:
    rows, columns = np.mgrid[: SHAPE[0], : SHAPE[1]]
    mask = np.asarray(np.hypot(columns - x, rows - y) < radius)
    image = np.zeros((*SHAPE, 3), np.uint8)
    cut, on = squared(image, mask, (x, y), radius, size_px)
    assert cut.shape == (size_px, size_px, 3)
    assert on.shape == (size_px, size_px)
    _, _, found = enclosing_circle(on)
    inside = radius < min(x, y, SHAPE[1] - 1 - x, SHAPE[0] - 1 - y)
    if inside:
        assert found == pytest.approx(FRAME_FILL * size_px / 2, abs=1.0 + size_px / radius)


def frame_of(staging: Staging, number: int, stamp_ns: int | None = None) -> Frame:
    return Frame(number * 250_000_000 if stamp_ns is None else stamp_ns, number, seen(staging, number)[0], None)


def test_a_found_frame_gives_the_same_percept_again(desk: BackgroundModel) -> None:
    finder, descriptor = ObjectFinder(Segmenter(Background(desk)), 64), ColourCooccurrence()
    found = finder.find(frame_of(CALM, 1), [0.0])
    assert found.mask is not None
    assert found.image.shape == (64, 64, 3)
    history = [JointState(stamp_ns, (0.0,), (0.0,), False) for stamp_ns in (0, 10**9)]
    twice = [perceive(found, history, preset("turntable"), descriptor) for _ in range(2)]
    np.testing.assert_array_equal(twice[0].feature, twice[1].feature)
    assert found.stamp_ns == 250_000_000


def test_the_scale_is_that_of_the_largest_view_until_it_is_forgotten(desk: BackgroundModel) -> None:
    finder, smaller = (
        ObjectFinder(Segmenter(Background(desk), limits=Limits(area_jump=90.0)), 64),
        replace(CALM, object_px=100),
    )
    large = finder.find(frame_of(CALM, 0), [0.0])
    small = finder.find(frame_of(smaller, 1), [0.0])
    late = finder.find(frame_of(smaller, 2, FORGET_NS * 2), [0.0])
    areas = [float(frame.mask.mean()) for frame in (large, small, late) if frame.mask is not None]
    assert areas[1] == pytest.approx(areas[0] * (100 / 144) ** 2, rel=0.1)
    assert areas[2] == pytest.approx(areas[0], rel=0.1)
    fixed = ObjectFinder(Segmenter(Background(desk)), 64, radius_px=140.0).find(frame_of(CALM, 0), [0.0])
    assert fixed.mask is not None
    assert fixed.mask.mean() < 0.5 * areas[0]


def test_a_bad_mask_is_told(desk: BackgroundModel) -> None:
    frame = Frame(0, 0, empty(CALM, 0)[0][0], None)
    with pytest.raises(BadInput, match="no object stands out"):
        ObjectFinder(Segmenter(Background(desk)), 64).find(frame, [0.0])


def test_the_configuration_names_the_method(tmp_path: Path, desk: BackgroundModel) -> None:
    save_background(desk, tmp_path / "background.npz")
    config = parse_config(
        {"perception": {"method": "background", "background": str(tmp_path / "background.npz")}}, "here"
    )
    finder = finder_of(config)
    assert finder is not None
    assert finder.find(frame_of(CALM, 0), [0.0]).image.shape == (128, 128, 3)
    assert finder_of(Config()) is None
    plain = finder_of(parse_config({"perception": {"method": "plain", "limits": {"area_jump": 2.0}}}, "here"))
    assert plain is not None
    assert isinstance(plain.figure_ground, Segmenter)
    assert plain.figure_ground.limits.area_jump == 2.0
    region = finder_of(parse_config({"perception": {"method": "region", "region": [10, 20, 30, 40]}}, "here"))
    assert region is not None
    assert region.figure_ground == FixedRegion(Box(10, 20, 40, 60))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"method": "background"}, "key 'perception.background' is missing"),
        ({"method": "region"}, "key 'perception.region' is missing"),
        ({"method": "region", "region": [-1, 0, 5, 5]}, "left and top must be at least 0"),
        ({"method": "guess"}, "perception.method"),
        ({"limits": {"smallest": 0.1}}, "unknown key 'perception.limits.smallest'"),
    ],
)
def test_a_method_that_lacks_something_is_told(table: dict[str, object], said: str) -> None:
    with pytest.raises(BadConfig, match=said):
        parse_config({"perception": table}, "here")


def test_the_example_shows_the_defaults() -> None:
    example = Path(__file__).parents[2] / "docs" / "config" / "gimbal.toml"
    assert load_config(example).perception == Config().perception
    assert Limits(**Config().perception.limits.model_dump()) == Limits()


@pytest.mark.shared
def test_photos_on_a_desk_are_cut_out(shared: Path) -> None:
    overlaps, staging = [], Staging(seed=5)
    background = Background(learn_background(empty(staging, 0, 0, 0)))
    for name in ("obj005", "obj054"):
        view_set, track = read_view_set(shared / "photos" / "coil100" / name), Track()
        for number in range(0, 24, 4):
            image = view_set.load(number)[0]
            alone = Segmenter(PlainBackdrop(), limits=Limits(border_share=1.0, largest_share=0.95))
            mask = alone.segment(image, (), Track()).mask
            picture, truth = Stage(staging).exposed(image, mask, [0.0], number * 10**8, number)
            figure = Segmenter(background).segment(picture, [0.0], track)
            track = figure.track
            assert figure.problem == ""
            overlaps.append(overlap(figure.mask, truth))
    assert np.median(overlaps) >= 0.95


def test_the_axis_of_the_turntable_is_the_plates() -> None:
    """The plate's print turns as the object does: by the last joint, about the vertical."""
    np.testing.assert_allclose(
        preset("turntable").holder_rotation([0.3]), axis_rotation(np.array([0, 0, 1.0]), 0.3), atol=1e-9
    )
